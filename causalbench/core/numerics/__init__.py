"""Arithmetic that every floor uses: rotations, and loops compiled where that is possible."""
