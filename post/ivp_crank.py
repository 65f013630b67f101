#!/usr/bin/env python3
"""Starts the program ivp_crank (biela/commands/ivp_crank.py); --help says what it does."""

from start import start

if __name__ == "__main__":
    start("ivp_crank")
