"""A block graph as a Mermaid flowchart."""
from simrob_drake.results.block_graph import BlockGraph


def mermaid_text(graph: BlockGraph) -> str:
    """Return the text of a block graph; the same graph gives the same text."""
    return ""
