"""A range: who is near enough to the sender hears it, one control period later."""

from vibroswarm.networks import Network


class Params:
    range_m: float = 0.3


def send(n, a, sender, tick, number, bytes_on_air, x_m, y_m, arrival_tick, d, p, w):
    for j in range(x_m.size):
        far2 = (x_m[j] - x_m[sender]) ** 2 + (y_m[j] - y_m[sender]) ** 2
        arrival_tick[j] = tick + 1 if far2 < p.range_m**2 else -1


near = Network(name="near", params=Params, send=send)
