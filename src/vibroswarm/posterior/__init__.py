"""The posterior of a floor where readings depend on several tiles and on factors they share: by sampling."""
