"""An inspection in three dimensions, in a browser (viser)."""
