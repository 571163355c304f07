"""The figures of docs/network.md but for traffic: `python -m tests.procboard.routing.measures`."""

from __future__ import annotations

from procboard.routing.neighbours import NeighbourLost
from tests.procboard.routing.air import Air, clique, line
from tests.procboard.routing.boards import cost_of_tree, sampling, shortest
from tests.procboard.routing.test_collection import boards, connected
from tests.procboard.routing.test_neighbours import Beaconer, mean_etx
from tests.procboard.routing.test_time_sync import clocks, first, worst
from tests.procboard.routing.test_trickle import messages_per_interval


def trickle() -> None:
    for loss in (0.0, 0.3):
        counts = [f"{n}: {messages_per_interval(n, loss):.2f}" for n in (2, 20, 100)]
        print(f"trickle, loss {loss}: messages an interval of", ", ".join(counts))


def neighbours() -> None:
    for there, back in ((0.3, 0.3), (0.5, 0.1), (0.1, 0.5)):
        true = 1 / (1 - there) / (1 - back)
        beacons, unicasts = mean_etx(there, back, False), mean_etx(there, back, True)
        print(f"ETX, loss {there} {back}: {true:.2f} beacons {beacons:.2f} unicasts {unicasts:.2f}")
    nodes = [Beaconer(n) for n in range(8)]
    Air(nodes, clique(8, 0.3), seed=3).run(5 * 3600)
    lost = sum(isinstance(event, NeighbourLost) for node in nodes for event in node.events)
    print(f"living neighbours lost at loss 0.3: {lost} in {56 * 5} neighbour hours")


def trees() -> None:
    ratios = []
    for seed in range(40):
        count = 2 + seed % 14
        links = connected(count, seed)
        air = Air(boards(count, seed), links, seed)
        sampling(air, 10, 300)
        air.run(300)
        best = shortest(links)
        ratios += [cost_of_tree(air, n) / best[n] for n in range(1, count)]
    print(f"ways over shortest: mean {sum(ratios) / len(ratios):.3f}, worst {max(ratios):.2f}")


def times() -> None:
    for loss in (0.0, 0.3):
        for count in (2, 4, 7, 10):
            ticks = []
            for seed in range(12):
                air = Air(clocks(count, seed), line(count, loss), seed)
                first(air, 0)
                air.run(100 + count * 60 / (1 - loss) ** 2)
                ticks.append(worst(air, air.time / 1000 + 300))
            print(f"time, {count - 1} hops, loss {loss}: worst of 12 runs {max(ticks)} ticks")


if __name__ == "__main__":
    trickle()
    neighbours()
    trees()
    times()
