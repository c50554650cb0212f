"""Numbers from results: outcomes, times, intervals. What is drawn is computed here."""
