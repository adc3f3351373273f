"""The stages of a run, from tissue to report; `run` does them, none of them twice."""
