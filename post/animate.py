#!/usr/bin/env python3
"""Starts the program animate (biela/commands/animate.py); --help says what it does."""

from start import start

if __name__ == "__main__":
    start("animate")
