"""The one-file page that shows a run."""
