"""Items of the reproduction that are more than figures of cells: ``compute`` adds to what comes of an item."""
