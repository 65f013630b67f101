#!/usr/bin/env python3
"""Starts the program sensitivity (biela/commands/sensitivity.py); --help says what it does."""

from start import start

if __name__ == "__main__":
    start("sensitivity")
