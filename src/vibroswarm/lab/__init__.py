"""The laboratory: robots in videos, recordings replayed under other strategies, spectra of what they measured."""
