#!/usr/bin/env python3
"""Starts the program plot (biela/commands/plot.py); --help says what it does."""

from start import start

if __name__ == "__main__":
    start("plot")
