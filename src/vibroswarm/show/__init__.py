"""Documents: what a result says, as one value, and its four ways out: terminal, page, notebook, JSON."""
