"""Stages that predict flow and oxygen.

Goes in: a network. Comes out: flow and oxygen. Begin with `flow.py`.
"""
