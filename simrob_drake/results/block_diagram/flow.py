"""How signals go through a picture: as nets that branch, from column to column."""

from collections import defaultdict
from dataclasses import dataclass, field

from simrob_drake.parts.captions import BlockRole
from simrob_drake.results.block_diagram.graph import BARS, BlockGraph, DrawnBlock

_COLUMNS: tuple[tuple[BlockRole, ...], ...] = (
    ("reference",),
    ("loop", "own"),
    ("servo",),
    ("force",),
    ("robot",),
    ("sensor", "scene"),
)


@dataclass
class Net:
    """A signal on its way from a block to all that read it: drawn as one line that branches."""

    source: str
    text: str
    both: bool
    targets: list[str] = field(default_factory=list)


def nets_of(graph: BlockGraph) -> list[Net]:
    """Return the signals: arrows of one name from one block are one net, also those to the station's outputs."""
    nets: dict[tuple[str, str, str], Net] = {}
    outputs: dict[tuple[str, str], list[str]] = defaultdict(list)
    for arrow in graph.drawn_arrows():
        source, target = graph.blocks[arrow.source], graph.blocks[arrow.target]
        if target.shape == "port":
            outputs[source.key, target.robot].append(target.key)
            continue
        joint = target.key.rpartition(".")[0] if source.shape == "bus" else ""
        key = source.key, arrow.text, target.key if arrow.both else joint
        nets.setdefault(key, Net(source.key, arrow.text, arrow.both)).targets.append(target.key)
    for (source_key, robot), targets in outputs.items():
        known = [net for (key, text, only), net in nets.items() if key == source_key and not only]
        text = ", ".join(dict.fromkeys(signal for key in targets for signal in graph.arrows[source_key, key]))
        whole = next((net for net in known if net.text == text), None)
        if whole is None:
            whole = nets.setdefault((source_key, text, f" {robot}"), Net(source_key, text, both=False))
        whole.targets += targets
    return list(nets.values())


def columns_of(graph: BlockGraph) -> dict[str, int]:
    """Return the column of each block: the roles in the order of the signal flow, what only shows at the end."""
    found: dict[str, int] = {}
    after, bars_end = 0, True
    for roles in _COLUMNS:
        blocks = [block for block in graph.blocks.values() if block.role in roles and not _is_output(graph, block)]
        depths = _depths(graph, [block.key for block in blocks])
        if roles == ("force",) and blocks and not bars_end:
            after -= 1  # below the servos
        found |= {key: after + depth for key, depth in depths.items()}
        if blocks:
            last = max(depths.values())
            bars_end = roles == ("reference",) or all(
                graph.blocks[k].shape in BARS for k in depths if depths[k] == last
            )
            after += last + 1
    found |= {block.key: after for block in graph.blocks.values() if _is_output(graph, block)}
    order = sorted(set(found.values()))
    return {key: order.index(column) for key, column in found.items()}


def _is_output(graph: BlockGraph, block: DrawnBlock) -> bool:
    """Tell whether a block is a port of an output, or feeds nothing, as a monitor."""
    return block.role == "sensor" and not graph.targets(block.key)


def _depths(graph: BlockGraph, keys: list[str]) -> dict[str, int]:
    """Return how many blocks of these come before each, at most; what leads back in a circle does not count."""
    done: list[str] = []  # each after what it leads to
    forward: dict[str, list[str]] = {}

    def visit(key: str, path: tuple[str, ...]) -> None:
        ahead = [
            target for target in graph.targets(key) if (target, key) not in graph.arrows or graph.forward(key, target)
        ]
        forward[key] = [target for target in ahead if target in keys and target not in path]
        for target in forward[key]:
            if target not in forward:
                visit(target, (*path, target))
        done.append(key)

    for key in keys:
        if key not in forward:
            visit(key, (key,))
    depths = dict.fromkeys(keys, 0)
    for key in reversed(done):
        for target in forward[key]:
            depths[target] = max(depths[target], depths[key] + 1)
    return depths
