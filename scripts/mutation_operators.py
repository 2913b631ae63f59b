"""Mutations of tables, enum members, texts, single statements, and min and max.

Cosmic Ray's own operators change comparisons, arithmetic, numbers and truth values. The mutated
files decide more often by a row of a table, a member of an enum, or an empty text (an empty refusal
grants the request). These operators change such code, with the same interface.
"""

import enum
import re
from collections.abc import Iterable, Iterator, Mapping

from cosmic_ray.operators.operator import Example, Operator
from parso.python import tree
from parso.tree import BaseNode, NodeOrLeaf

UNUSED = re.compile(r"del \w+(, \w+)*")

Place = tuple[tuple[int, int], tuple[int, int]]


class OneOfEach(Operator):
    """An operator with at most one mutation of a node, given by `replacement`."""

    def __init__(self, namespace: Mapping[str, object], source: str) -> None:
        """Store the module's `namespace`, which distinguishes an enum from another class."""
        self.namespace = namespace
        self.source = source

    def replacement(self, node: NodeOrLeaf) -> str | None:
        """Return the code that replaces the node; None if there is nothing to change."""
        raise NotImplementedError

    def mutation_positions(self, node: NodeOrLeaf) -> Iterator[Place]:
        """As `Operator.mutation_positions`."""
        if self.replacement(node) is not None:
            yield node.start_pos, node.end_pos

    def mutate(self, node: NodeOrLeaf, index: int) -> NodeOrLeaf:  # noqa: ARG002 - its interface
        """As `Operator.mutate`."""
        new = tree.Name(self.replacement(node) or "", node.start_pos, _prefix(node))
        new.parent = node.parent
        return new

    @classmethod
    def examples(cls) -> Iterable[Example]:
        """Return no examples: these operators need a namespace."""
        return ()


def _prefix(node: NodeOrLeaf) -> str:
    return node.get_first_leaf().prefix


class NextMember(OneOfEach):
    """Replaces `Enum.MEMBER` by the next member, and a constant by the next one of its type."""

    def replacement(self, node: NodeOrLeaf) -> str | None:
        """Return the name of the next member or constant."""
        if node.type in {"atom_expr", "power"} and len(node.children) == 2:
            owner, trailer = node.children
            found = self.namespace.get(owner.get_code().strip())
            if isinstance(found, enum.EnumMeta):
                member = trailer.get_code().strip().lstrip(".")
                names = [one.name for one in found]
                if member in names:
                    return f"{owner.value}.{names[(names.index(member) + 1) % len(names)]}"
        return self._constant(node) if _is_read(node) else None

    def _constant(self, node: tree.Name) -> str | None:
        value = self.namespace.get(node.value)
        if not isinstance(value, (int, float, enum.Enum)) or isinstance(value, bool):
            return None
        alike = [
            name
            for name, other in self.namespace.items()
            if type(other) is type(value) and (other != value or name == node.value)
        ]
        after = alike[(alike.index(node.value) + 1) % len(alike)]
        return after if after != node.value else None


def _is_read(node: NodeOrLeaf) -> bool:
    if not isinstance(node, tree.Name) or node.is_definition():
        return False
    parent = node.parent
    if parent.type == "trailer" and parent.children[0].value == ".":
        return False
    return not (parent.type == "argument" and parent.children[0] is node)


class OtherBound(OneOfEach):
    """Swaps `min` and `max`, and fields `..._min_...` and `..._max_...` if the file reads both."""

    def replacement(self, node: NodeOrLeaf) -> str | None:
        """Return the name of the opposite bound."""
        if not isinstance(node, tree.Name) or node.is_definition():
            return None
        if node.value in {"min", "max"}:
            return "max" if node.value == "min" else "min"
        for one, other in (("_min_", "_max_"), ("_max_", "_min_")):
            swapped = node.value.replace(one, other)
            if swapped != node.value and f".{swapped}" in self.source:
                return swapped
        return None


class NoRow(OneOfEach):
    """Removes a row of a table: of a dict, of a set, of a tuple with a name at module level."""

    def mutation_positions(self, node: NodeOrLeaf) -> Iterator[Place]:
        """Yield one position for each row."""
        for row in _rows(node):
            yield row[0].start_pos, row[-1].end_pos

    def mutate(self, node: BaseNode, index: int) -> BaseNode:
        """Return the node without the row."""
        gone = {id(leaf) for leaf in _rows(node)[index]}
        node.children = [child for child in node.children if id(child) not in gone]
        return node


def _rows(node: NodeOrLeaf) -> list[list[NodeOrLeaf]]:
    """Children of each row, with the comma behind it; empty if the node is no table."""
    is_table = node.type == "dictorsetmaker" or (
        node.type == "testlist_comp"
        and node.parent.parent.type in {"expr_stmt", "annassign"}
        and node.parent.parent.get_first_leaf().column == 0
    )
    if not is_table or any(child.type.endswith("comp_for") for child in node.children):
        return []
    rows: list[list[NodeOrLeaf]] = [[]]
    for child in node.children:
        rows[-1].append(child)
        if child.type == "operator" and child.value == ",":
            rows.append([])
    return [row for row in rows if row]


class OtherText(OneOfEach):
    """Empties a text, or fills an empty one; leaves docstrings alone."""

    def replacement(self, node: NodeOrLeaf) -> str | None:
        """Return the replacement text."""
        if node.type not in {"string", "fstring"} or node.parent.type in {"simple_stmt", "strings"}:
            return None if node.type != "strings" else '""'
        return '"mutant"' if node.get_code().strip() == '""' else '""'


class NoStatement(OneOfEach):
    """Removes a statement of a function: a return, a yield, an assignment."""

    def replacement(self, node: NodeOrLeaf) -> str | None:
        """Return `pass` for a statement inside a function."""
        if node.parent is None or node.parent.type != "simple_stmt":
            return None
        if tree.search_ancestor(node, "funcdef") is None:
            return None
        if node.type in {"newline", "string", "strings"} or node.get_code().strip() == "pass":
            return None
        # `del argument` says that an argument is not used.
        return None if UNUSED.fullmatch(node.get_code().strip()) else "pass"


OPERATORS = (NextMember, OtherBound, NoRow, OtherText, NoStatement)
