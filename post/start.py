#!/usr/bin/env python3
"""Starts the program by whose name it is called: the other .py files here are links to this one."""

from biela.programs import start

start(__file__)
