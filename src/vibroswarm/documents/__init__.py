"""The document of each kind of result: one function a kind, which terminal, page, notebook and JSON show."""
