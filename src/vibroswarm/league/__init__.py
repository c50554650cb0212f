"""The league: strategies on the same floors, motion, readings and radio, with what each costs to send."""
