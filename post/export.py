#!/usr/bin/env python3
"""Starts the program export (biela/commands/export.py); --help says what it does."""

from start import start

if __name__ == "__main__":
    start("export")
