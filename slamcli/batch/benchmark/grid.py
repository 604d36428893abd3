"""The grid of variants: every combination of the values of the options that are to be compared, and the peers."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields
from itertools import product
from typing import Any

from slamcli.batch.benchmark.peers.settings import PEERS
from slamcli.errors import UsageError
from slamcli.formats.configuration import suggestion
from slamcli.solver.options import OptimizeOptions

#: Name of the tool that is no peer.
OURS = "slamcli"
#: More variants than this are a mistake.
MOST = 200


@dataclass(frozen=True)
class Variant:
    """One way to optimize.

    Attributes
    ----------
    label
        As tables have it: ``slamcli``, ``method=gn ordering=amd``, ``gtsam``.
    tool
        ``slamcli`` or the name of a peer.
    options
        Of ``OptimizeOptions``, where they are not the defaults; empty for peers.
    """

    label: str
    tool: str = OURS
    options: Mapping[str, Any] = field(default_factory=dict)

    @property
    def is_peer(self) -> bool:
        """Whether it is a peer."""
        return self.tool != OURS

    @property
    def minimizes_chi2(self) -> bool:
        """Whether chi2 is what it minimizes: robust kernels and methods have costs of their own."""
        chosen = OptimizeOptions(**self.options)
        return chosen.kernel == "none" and chosen.robust == "none"


def parameters(texts: Iterable[str]) -> dict[str, tuple[Any, ...]]:
    """Options and their values from texts such as ``method=gn,lm`` and ``max-iterations=10,50``.

    Values of an option with several values each (``fix``) are joined by ``+``: ``fix=0,0+5``.

    Raises
    ------
    UsageError
        If there is no such option or no such value.
    """
    kinds = {one.name: str(one.type) for one in fields(OptimizeOptions)}
    found: dict[str, tuple[Any, ...]] = {}
    for text in texts:
        name, equals, words = text.partition("=")
        name = name.strip().replace("-", "_")
        if not equals or not words:
            raise UsageError(f"--param {text!r}: expected NAME=VALUE,VALUE,...")
        if name not in kinds:
            raise UsageError(f"--param: the optimizer has no option {name!r}", (suggestion(name, kinds, "one of"),))
        if name in found:
            raise UsageError(f"--param: {name} stands twice", ("  give all its values in one: NAME=V1,V2",))
        values = tuple(_value(name, word.strip(), kinds[name]) for word in words.split(","))
        if len(set(values)) < len(values):
            raise UsageError(f"--param {text!r}: a value stands twice")
        for value in values:
            _checked({name: value})
        found[name] = values
    return found


def _value(name: str, word: str, kind: str) -> Any:
    """A value of the type that the option has."""
    try:
        if kind.startswith("tuple"):
            return tuple(int(part) for part in word.split("+"))
        if "None" in kind and word == "none":
            return None
        if "float" in kind:
            number = float(word)
            if abs(number) < 1e300:
                return number
            raise ValueError
        if "int" in kind:
            return int(word)
    except ValueError:
        wanted = "ids joined by +" if kind.startswith("tuple") else "an integer" if kind == "int" else "a number"
        raise UsageError(f"--param {name}: expected {wanted}, got {word!r}") from None
    return word


def _checked(options: dict[str, Any]) -> None:
    try:
        OptimizeOptions(**options)
    except UsageError as error:
        raise UsageError(f"--param {error.message}", error.details) from None


def variants(found: Mapping[str, tuple[Any, ...]], peers: Iterable[str] = ()) -> tuple[Variant, ...]:
    """The product of all values, the last option changing fastest, then the peers.

    Raises
    ------
    UsageError
        If two options contradict each other, or the grid has more than ``MOST`` variants.
    """
    count = 1
    for values in found.values():
        count *= len(values)
    if count > MOST:
        raise UsageError(f"--param: the grid has {count} variants", (f"  at most {MOST}",))
    made = []
    for values in product(*found.values()):
        options = dict(zip(found, values, strict=True))
        _checked(options)
        made.append(Variant(" ".join(f"{k}={shown(v)}" for k, v in options.items()) or OURS, OURS, options))
    return (*made, *(Variant(peer, peer) for peer in peers))


def shown(value: Any) -> str:
    """A value as ``parameters`` reads it."""
    if isinstance(value, tuple):
        return "+".join(map(str, value))
    return "none" if value is None else f"{value:g}" if isinstance(value, float) else str(value)


def peers(texts: Iterable[str]) -> tuple[str, ...]:
    """Names of peers from texts such as ``gtsam,g2opy``.

    Raises
    ------
    UsageError
        If there is no such peer, or it is not installed.
    """
    import importlib.util

    names = [word.strip() for text in texts for word in text.split(",")]
    for name in names:
        if name not in PEERS:
            raise UsageError(f"--peers: there is no peer {name!r}", (suggestion(name, PEERS, "one of"),))
        if importlib.util.find_spec(name) is None:
            raise UsageError(f"--peers: {name} is not installed", ("  pip install 'slamcli[peers]'",))
    return tuple(dict.fromkeys(names))
