"""From TOML and `--set` to a validated `Scenario`, and back to TOML.

Layers are merged as plain dictionaries, the defaults first, then the chain of `base` scenarios,
then the file, then the command line, and only the result is converted to types. Each leaf remembers
the layer it came from, so that a message names the file (or the option) that must be mended, the
key's full path, its value and what is allowed there. A resolved scenario is written without `base`:
it stands alone, and loads to the identical configuration.
"""

from __future__ import annotations

import difflib
import math
import re
import tomllib
import types
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Union, get_args, get_origin, get_type_hints

import msgspec

from tools.configuration import Scenario
from tools.contradictions import KeyPath, Step, contradictions, inwards
from tools.errors import ScenarioError

DEFAULT = "swim-forward"
DEFAULTS = "defaults"
"""The origin of a value that nobody set."""

FOLDER = Path(__file__).resolve().parent / "scenarios"


def bundled() -> dict[str, Path]:
    """Bundled scenarios by name, in alphabetical order."""
    return {path.stem: path for path in sorted(FOLDER.glob("*.toml"), key=lambda path: path.stem)}


def load(
    source: str | Path = DEFAULT,
    sets: Iterable[str] = (),
    *,
    duration_s: float | None = None,
    seed: int | None = None,
) -> Scenario:
    """Load a bundled scenario by its name, or a TOML file, with overrides.

    `sets` are `KEY=VALUE` texts with a dotted key and a TOML value. Raises `ScenarioError`, whose
    text is one line.
    """
    return _layers(source, sets, duration_s, seed).convert()


def family(
    source: str | Path = DEFAULT,
    sets: Iterable[str] = (),
    *,
    duration_s: float | None = None,
    seed: int | None = None,
    origin: str = "--set",
) -> Callable[[Mapping[KeyPath, Any]], Scenario]:
    """Scenarios that differ in a few keys: what is common to them is read once.

    Returns what makes one of them from the values of its keys; `origin` is what messages call those
    values. Both may raise `ScenarioError`.
    """
    common = _layers(source, sets, duration_s, seed)

    def member(values: Mapping[KeyPath, Any]) -> Scenario:
        layers = common.copy()
        for path, value in values.items():
            layers.set(path, value, origin)
        return layers.convert()

    return member


def _layers(
    source: str | Path, sets: Iterable[str], duration_s: float | None, seed: int | None
) -> _Layers:
    """All layers of a scenario, merged and not yet converted."""
    layers = _Layers()
    for path, data in _chain(_locate(source)):
        _anchor(data, path.parent)
        layers.add(data, str(path))
    for text in sets:
        key, value = parse_set(text)
        layers.set(key, value, "--set")
    if duration_s is not None:
        layers.set(("scenario", "duration_s"), duration_s, "--duration")
    if seed is not None:
        layers.set(("scenario", "seed"), seed, "--seed")
    return layers


def from_mapping(data: Mapping[str, Any], origin: str = "scenario") -> Scenario:
    """Build a scenario from plain data laid over the defaults (no `base`, no files)."""
    layers = _Layers()
    layers.add(data, origin)
    return layers.convert()


def check(config: Scenario) -> None:
    """Look again for what no single key can know, after keys were replaced.

    Raises `ScenarioError` with the first contradiction.
    """
    for paths, says in contradictions(config):
        raise ScenarioError(f"{dotted(paths[0])}: {says}")


def to_toml(config: Scenario) -> str:
    """Write the fully resolved scenario; loading the text gives the identical configuration."""
    import tomli_w

    return tomli_w.dumps(_without_none(msgspec.to_builtins(config)))


def keys(config: Scenario) -> dict[str, Any]:
    """Every leaf of a scenario by its dotted key."""
    return {dotted(path): value for path, value in _leaves(msgspec.to_builtins(config))}


def parse_set(text: str, option: str = "--set") -> tuple[KeyPath, Any]:
    """Split `KEY=VALUE`; the value is TOML, and a bare word is a string.

    Messages begin with the option that the text came from.
    """
    key, equals, value = (part.strip() for part in text.partition("="))
    if not equals or not key or not value:
        raise ScenarioError(
            f"{option} {text}: write KEY=VALUE, such as {option} plant.body.mass_kg=0.32"
        )
    path: list[Step] = []
    for part in key.split("."):
        match = re.fullmatch(r"([A-Za-z0-9_-]+)((?:\[\d+\])*)", part)
        if match is None:
            raise ScenarioError(f"{option} {text}: '{part}' is no key; keys are joined by dots")
        path.append(match[1])
        path.extend(int(index) for index in re.findall(r"\d+", match[2]))
    try:
        parsed = tomllib.loads(f"value = {value}")
    except tomllib.TOMLDecodeError:
        if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_.-]*", value):
            raise ScenarioError(
                f"{option} {text}: '{value}' is no TOML value: "
                'a number, true, false, "text" or [1, 2]'
            ) from None
        parsed = {"value": value}
    if list(parsed) != ["value"]:
        raise ScenarioError(f"{option} {text}: one value is wanted")
    return tuple(path), parsed["value"]


def dotted(path: KeyPath) -> str:
    """`("a", "b", 0, "c")` as `a.b[0].c`."""
    text = ""
    for step in path:
        text += f"[{step}]" if isinstance(step, int) else f".{step}"
    return text.removeprefix(".")


def _locate(source: str | Path) -> Path:
    """Find the file that a scenario name or path means."""
    names = bundled()
    if str(source) in names:
        return names[str(source)]
    path = Path(source)
    if path.suffix == ".toml" or path.exists():
        return path
    close = difflib.get_close_matches(str(source), names, n=1)
    hint = f"did you mean {close[0]}?" if close else f"bundled: {', '.join(names)}"
    raise ScenarioError(f"{source}: no scenario of this name and no such file; {hint}")


def _anchor(data: dict[str, Any], folder: Path) -> None:
    """Take paths that a scenario names as relative to its own file."""
    tank = data.get("tank")
    for field in tank.values() if isinstance(tank, dict) else ():
        named = field.get("file") if isinstance(field, dict) else None
        if isinstance(named, str) and named:
            field["file"] = str((folder / named).absolute())


def _read(path: Path) -> dict[str, Any]:
    """Read one TOML file; every way in which this fails is the user's to mend."""
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except tomllib.TOMLDecodeError as error:
        raise ScenarioError(f"{path}: not valid TOML: {error}") from error
    except UnicodeDecodeError as error:
        raise ScenarioError(f"{path}: not a text file in UTF-8") from error
    except OSError as error:
        raise ScenarioError(f"{path}: cannot be read: {error.strerror}") from error


def _chain(path: Path) -> list[tuple[Path, dict[str, Any]]]:
    """The scenario and the ones that it is based on, the most basic first."""
    chain: list[tuple[Path, dict[str, Any]]] = []
    seen: list[Path] = []
    while True:
        if path.resolve() in seen:
            raise ScenarioError(f"{path}: 'base' goes round in a circle")
        seen.append(path.resolve())
        data = _read(path)
        base = data.pop("base", None)
        chain.insert(0, (path, data))
        if base is None:
            return chain
        if not isinstance(base, str):
            raise ScenarioError(f"{path}: base = {base!r}: must be a scenario's name or a file")
        beside = path.parent / base
        path = beside if beside.suffix == ".toml" and beside.exists() else _locate(base)


class _Layers:
    """Merged plain data, and where each leaf of it came from."""

    def __init__(self) -> None:
        self.data: dict[str, Any] = _without_none(msgspec.to_builtins(Scenario()))
        self.origins: dict[KeyPath, str] = {}

    def copy(self) -> _Layers:
        """The same layers, to lay more over without touching these."""
        other = _Layers.__new__(_Layers)
        other.data, other.origins = _without_none(self.data), dict(self.origins)
        return other

    def add(self, data: Mapping[str, Any], origin: str) -> None:
        """Lay a table over what is there; lists are replaced, tables are merged."""
        self._merge(self.data, data, (), origin)

    def _merge(
        self, into: dict[str, Any], data: Mapping[str, Any], at: KeyPath, origin: str
    ) -> None:
        for key, value in data.items():
            path = (*at, key)
            if isinstance(value, Mapping) and isinstance(into.get(key), dict):
                self._merge(into[key], value, path, origin)
            else:
                into[key] = value
                self._note(path, origin)

    def set(self, path: KeyPath, value: Any, origin: str) -> None:
        """Set one key, also inside an element of a list."""
        place: Any = self.data
        for depth, step in enumerate(path[:-1]):
            if isinstance(place, list) and isinstance(step, int) and step < len(place):
                place = place[step]
            elif isinstance(place, dict) and isinstance(step, str):
                place = place.setdefault(step, {})
            else:
                where = dotted(path[: depth + 1])
                raise ScenarioError(f"{origin}: there is no {where} to set something in")
        last = path[-1]
        if isinstance(place, dict) and isinstance(last, str):
            self._merge(place, {last: value}, path[:-1], origin)
        elif isinstance(place, list) and isinstance(last, int) and last < len(place):
            place[last] = value
            self._note(path, origin)
        else:
            raise ScenarioError(f"{origin}: there is no {dotted(path)} to set")

    def _note(self, path: KeyPath, origin: str) -> None:
        for known in [known for known in self.origins if known[: len(path)] == path]:
            del self.origins[known]
        self.origins[path] = origin

    def origin(self, path: KeyPath) -> str:
        """The layer that a key came from."""
        for length in range(len(path), 0, -1):
            if path[:length] in self.origins:
                return self.origins[path[:length]]
        inside = (text for known, text in self.origins.items() if known[: len(path)] == path)
        return next(inside, DEFAULTS)

    def convert(self) -> Scenario:
        """To types, with every check."""
        for path, value in _leaves(self.data):
            if isinstance(value, float) and not math.isfinite(value):
                raise self._wrong(path, "must be a finite number")
        try:
            config = msgspec.convert(self.data, Scenario)
        except msgspec.ValidationError as error:
            raise self._translate(str(error)) from None
        for paths, says in contradictions(config):
            blamed = [path for path in paths if self.origin(path) != DEFAULTS]
            raise self._wrong((blamed or list(paths))[0], says)
        return config

    def _wrong(self, path: KeyPath, says: str) -> ScenarioError:
        value = _short(_value_at(self.data, path))
        return ScenarioError(f"{self.origin(path)}: {dotted(path)} = {value}: {says}")

    def _translate(self, message: str) -> ScenarioError:
        """Turn msgspec's message into ours: path, value, what is allowed, and the file."""
        what, _, where = message.partition(" - at `$")
        path = _parse_path(where.rstrip("`"))
        unknown = re.search(r"unknown field `(.*)`", what)
        if unknown:
            return self._unknown((*path, unknown[1]))
        missing = re.search(r"missing required field `(.*)`", what)
        if missing:
            full = dotted((*path, missing[1]))
            return ScenarioError(f"{self.origin(path)}: {full} is missing and has no default")
        if what.startswith("Invalid enum value"):
            choices = get_args(bare_type(_type_at(path)))
            return self._wrong(path, f"must be one of {', '.join(map(repr, choices))}")
        return self._wrong(path, _allowed(what, _type_at(path)))

    def _unknown(self, path: KeyPath) -> ScenarioError:
        name = str(path[-1])
        here = sorted(field_types(path[:-1]))
        says = "no such key"
        stem = name.rsplit("_", 1)[0]
        same_stem = [key for key in here if key.rsplit("_", 1)[0] == stem and "_" in name]
        close = same_stem or difflib.get_close_matches(name, here, n=1, cutoff=0.6)
        if close:
            says += f"; did you mean {dotted((*path[:-1], close[0]))}?"
            if same_stem:
                says += " (values are in SI units, angles in radians)"
        else:
            elsewhere = [key for key in _all_keys() if key.split(".")[-1] == name]
            if elsewhere:
                says += f"; did you mean {elsewhere[0]}?"
            else:
                says += f"; allowed here: {', '.join(here)}"
        return ScenarioError(f"{self.origin(path)}: {dotted(path)}: {says}")


def field_types(path: KeyPath) -> dict[str, Any]:
    """Names and types of the keys of the table at a path of `Scenario`."""
    kind = bare_type(_type_at(path))
    is_table = isinstance(kind, type) and issubclass(kind, msgspec.Struct)
    return get_type_hints(kind, include_extras=True) if is_table else {}


def declared_type(path: KeyPath) -> Any:
    """The declared type of a key, without bounds and `| None`; None where there is no such key."""
    try:
        return bare_type(_type_at(path))
    except (KeyError, IndexError, TypeError):
        return None


def _type_at(path: KeyPath) -> Any:
    """The declared type of the value at a path of `Scenario`."""
    kind: Any = Scenario
    for step in path:
        kind = bare_type(kind)
        if isinstance(step, int):
            kind = get_args(kind)[0]
        else:
            kind = get_type_hints(kind, include_extras=True)[step]
    return kind


def bare_type(kind: Any) -> Any:
    """Take `Annotated` and `| None` off a type."""
    while True:
        if get_origin(kind) is Annotated:
            kind = get_args(kind)[0]
        elif _is_union(kind):
            kind = next(arg for arg in get_args(kind) if arg is not type(None))
        else:
            return kind


def _all_keys(at: KeyPath = ()) -> Iterator[str]:
    """Every key of the scenario's tables (not inside lists), dotted."""
    for name in field_types(at):
        yield dotted((*at, name))
        yield from _all_keys((*at, name))


_TYPE_WORDS = {
    "float": "a number",
    "int": "a whole number",
    "str": 'a text in quotes ("…")',
    "bool": "true or false",
    "array": "a list in [ ]",
    "object": "a table",
    "null": "absent",
}


def _allowed(what: str, declared: Any) -> str:
    """What a declared type allows, given msgspec's complaint: `must be a number > 0 and <= 1`."""
    match = re.match(r"Expected `([^`]*)`", what)
    if match is None:
        return what[0].lower() + what[1:]
    if "regex" in what:
        return "must begin with a letter or digit and hold only letters, digits, . _ -"
    kinds = [_TYPE_WORDS.get(kind.strip(), kind.strip()) for kind in match[1].split("|")]
    says = "must be " + " or ".join(kind for kind in kinds if kind != "absent")
    length = re.search(r"of length (\d+)", what)
    if length:
        return f"{says} with {length[1]} elements"
    return f"{says} {bounds(declared)}".rstrip()


def bounds(declared: Any) -> str:
    """The range of a declared type in words: `> 0 and <= 1`; empty where there is none.

    Limits are shortened inwards, so that a limit that is printed is a value that is allowed.
    """
    options = (declared, *get_args(declared)) if _is_union(declared) else (declared,)
    return " and ".join(
        f"{sign} {inwards(getattr(meta, name), up=name[0] == 'g')}"
        for option in options
        for meta in getattr(option, "__metadata__", ())
        for name, sign in (("ge", ">="), ("gt", ">"), ("le", "<="), ("lt", "<"))
        if getattr(meta, name, None) is not None
    )


def _is_union(kind: Any) -> bool:
    return get_origin(kind) in (Union, types.UnionType)


def _parse_path(text: str) -> KeyPath:
    """`.faults.supply_cuts[0].at_s` → its steps."""
    steps: list[Step] = []
    for name, index in re.findall(r"\.([A-Za-z0-9_-]+)|\[(\d+)\]", text):
        steps.append(name or int(index))
    return tuple(steps)


def _leaves(data: Any, at: KeyPath = ()) -> Iterator[tuple[KeyPath, Any]]:
    items: Iterable[tuple[Step, Any]]
    if isinstance(data, Mapping):
        items = data.items()
    elif isinstance(data, Sequence) and not isinstance(data, str) and data:
        items = enumerate(data)
    else:
        yield at, data
        return
    for step, value in items:
        yield from _leaves(value, (*at, step))


def _without_none(data: Any) -> Any:
    """TOML has no null: an absent key is what None was."""
    if isinstance(data, dict):
        return {key: _without_none(value) for key, value in data.items() if value is not None}
    if isinstance(data, (list, tuple)):
        return [_without_none(value) for value in data]
    return data


def _value_at(data: Any, path: KeyPath) -> Any:
    for step in path:
        data = data[step]
    return data


def _short(value: Any) -> str:
    text = repr(value) if not isinstance(value, bool) else str(value).lower()
    return text if len(text) <= 60 else text[:57] + "…"
