"""What each robot believed, said and decided: a strategy replayed over observations."""
