"""Predict the ink that executed motion deposits in the bath.

From the plunger's motion to the flow out of the needle (`flow`), from there to what lies where
(`predict`), and what bath and needle do with it (`bath`, `drag`). Each says what it models, by
which source, and which of its constants were never measured.

Goes in: executed motion, an ink, a needle. Comes out: where ink lies, and how thick. Begin with
`predict.py`.
"""
