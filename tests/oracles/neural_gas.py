"""Fritzke's growing neural gas (NIPS 7, 1995) word by word, over dictionaries and sets."""

import math


class Gas:
    def __init__(self, first, second, config):
        self.config, self.signals = config, 0
        self.weight = {0: list(first), 1: list(second)}
        self.error = {0: 0.0, 1: 0.0}
        self.age = {}  # by frozenset of both ends

    def neighbours(self, unit):
        return {other for edge in self.age if unit in edge for other in edge - {unit}}

    def show(self, signal):
        c = self.config
        # 2. Find the nearest unit s1 and the second nearest unit s2.
        square = {u: math.dist(w, signal) ** 2 for u, w in self.weight.items()}
        s1, s2 = sorted(square, key=lambda u: (square[u], u))[:2]
        # 3. Increment the age of all edges emanating from s1.
        for edge in self.age:
            self.age[edge] += s1 in edge
        # 4. Add the squared distance to the error of s1.
        self.error[s1] += square[s1]
        # 5. Move s1 and its direct topological neighbours towards the signal.
        for unit, rate in [(s1, c.nearest_rate)] + [
            (n, c.neighbour_rate) for n in self.neighbours(s1)
        ]:
            self.weight[unit] = [
                w + rate * (x - w) for w, x in zip(self.weight[unit], signal, strict=True)
            ]
        # 6. If s1 and s2 are connected, set the age to zero; else create the edge.
        self.age[frozenset((s1, s2))] = 0
        # 7. Remove edges with an age larger than a_max, and points without edges.
        self.age = {edge: age for edge, age in self.age.items() if age <= c.oldest}
        for unit in [u for u in self.weight if not self.neighbours(u)]:
            del self.weight[unit], self.error[unit]
        # 8. Every lambda signals, insert a unit.
        self.signals += 1
        if self.signals % c.interval == 0 and len(self.weight) < c.neurons:
            q = max(self.error, key=lambda u: (self.error[u], -u))
            f = max(self.neighbours(q), key=lambda u: (self.error[u], -u))
            r = min(set(range(c.neurons)) - set(self.weight))
            self.weight[r] = [
                (a + b) / 2 for a, b in zip(self.weight[q], self.weight[f], strict=True)
            ]
            del self.age[frozenset((q, f))]
            self.age[frozenset((q, r))] = self.age[frozenset((r, f))] = 0
            self.error[q] *= c.split_decay
            self.error[f] *= c.split_decay
            self.error[r] = self.error[q]
        # 9. Decrease all errors.
        for unit in self.error:
            self.error[unit] *= c.decay
