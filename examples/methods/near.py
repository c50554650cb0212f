"""A method of search: points near the best candidate so far. ``vibroswarm optimize --method near.py:near``."""

from vibroswarm.search import Method, Sampler


class Near(Sampler):
    name = "near"

    def propose(self, count):
        centre = self.archive[self.best()].point if self.keys else 0.5
        steps = self.random().normal(0.0, 0.2, size=(count, self.archive.space.size))
        return list(centre + steps)  # points outside the unit cube are clipped


near = Method("near", Near.begin)
