#!/usr/bin/env python3
"""Starts the program fit_material (biela/commands/fit_material.py); --help says what it does."""

from start import start

if __name__ == "__main__":
    start("fit_material")
