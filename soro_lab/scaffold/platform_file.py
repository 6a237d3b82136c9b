"""The platform file of a new arm: a shipped platform with the chambers and the pressures of the arm."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping
from typing import Any

from pydantic import BaseModel

from soro_core.config import config_folder, find_config, read_yaml
from soro_core.errors import ConfigError
from soro_hardware.families import parse_platform
from soro_lab.scaffold.arm import ArmSetting
from soro_lab.scaffold.options import WHERE
from soro_lab.scaffold.quantity import Noted, rounded

# Short names and families, each with the shipped file that shows it.
ALIASES = {
    "emulated": "emulated_canopen",
    "canopen": "canopen_socketcan",
    "canopen_408": "canopen_socketcan",
    "itv": "itv_serial",
    "itv_rs232": "itv_serial",
    "alicat": "alicat_serial",
    "veab": "veab_tcp",
    "vtem": "vtem_modbus",
}
# Nodes of one valve that fit on the bus at 200 Hz with room to spare; beyond, nodes of four valves.
_SINGLE_NODES, _CHANNELS = 12, 4
# Address of a valve by its number.
_ADDRESSES: Mapping[str, Callable[[int], dict[str, Any]]] = {
    "canopen_408": lambda k: {"node": k + 1},
    "itv_rs232": lambda k: {},
    "alicat": lambda k: {"unit": chr(ord("A") + k)},
    "veab_tcp": lambda k: {"port": k},
    "soro_board": lambda k: {"port": k},
    "vtem_modbus": lambda k: {"slot": k // 2, "valve": k % 2},
}
# Full scales of the makes of an ITV [Pa].
_ITV_SCALES = (100e3, 500e3, 900e3)
# Range of the shipped files [Pa], and what a platform bears beyond the range of its set points.
_SHIPPED, RATING = 90e3, 100.0 / 90.0
_SUPPLY_MARGIN = 60e3
_OF_RANGE = "the range of the arm"
# What the numbers of tables are.
_TABLES = {"ports": "I2C bus and addresses; ", "scales": "[V, Pa gauge] of set points and readings; "}


def platform_name(given: str, n_chambers: int) -> str:
    """Return the shipped file that a name, a family or `emulated` stands for.

    Raises
    ------
    ConfigError
        With the names.
    """
    shipped = sorted(path.stem for path in (config_folder() / "platforms").glob("*.yaml"))
    name = ALIASES.get(given, given)
    if name not in shipped:
        raise ConfigError(WHERE, "--platform", given, f"emulated, or one of {', '.join(shipped)}")
    if name == "emulated_canopen" and n_chambers > _SINGLE_NODES:
        return "emulated_canopen_4ch"
    return name


def platform_tree(arm: ArmSetting, name: str) -> dict[str, Any]:
    """Return the platform file, after a shipped one, as a tree of `Noted` values.

    Raises
    ------
    ConfigError
        If the platform cannot have the chambers or the pressures of the arm.
    """
    path = find_config(name, "platforms")
    data = copy.deepcopy(read_yaml(path))
    low, high = arm.pressure_range.value
    chambers = [f"link{i}/chamber{j}" for i, count in enumerate(arm.chambers) for j in range(count)]
    own = _set_pressures(data, min(low, 0.0), high)
    address = _ADDRESSES[data["family"]]
    if name == "emulated_canopen_4ch":
        data["cycle_hz"] = 200.0
        data["canopen"]["stale_cycles"] = 10
        own |= {("cycle_hz",): "the rate of the scene", ("canopen", "stale_cycles"): "50 ms at 200 Hz"}

        def address(k: int) -> dict[str, Any]:
            return {"node": k // _CHANNELS + 1, "channel": k % _CHANNELS}

    data["valves"] = [{"chamber": chamber, **address(k)} for k, chamber in enumerate(chambers)]
    model = parse_platform(data, where=f"{arm.command} --platform {arm.platform}")
    tree = _noted(data, model, name, own, ())
    tree["valves"] = [
        Noted(valve, "its address is counted up: change it to that of your regulator")
        for valve in data["valves"]
    ]
    return tree


def platform_header(arm: ArmSetting, name: str) -> str:
    """Return the comment at the top of the platform file."""
    return (
        f"Regulators of {arm.name}, written by `{arm.command}` after the shipped {name}.yaml, which says"
        " more.\n`soro run` emulates them unless the scene or --valves says real. What each number means "
        "stands beside it; those under regulator are assumptions: soro fit pressures finds them."
    )


def _set_pressures(data: dict[str, Any], low: float, high: float) -> dict[tuple[str, ...], str]:
    """Change what depends on the range of pressures; return where the changed numbers come from.

    Parameters
    ----------
    data : dict
        Platform file, changed in place.
    low, high : float
        Range of set points [Pa gauge].
    """
    data["range"] = {"minimum_pa": low, "maximum_pa": high}
    data["rating"] = {"minimum_pa": rounded(min(low * RATING, 0.0)), "maximum_pa": rounded(high * RATING)}
    guess = "guess: a ninth beyond the range; look up what arm and regulators bear"
    own: dict[tuple[str, ...], str] = {
        ("range", "minimum_pa"): f"{_OF_RANGE}, and 0, to vent",
        ("range", "maximum_pa"): _OF_RANGE,
        ("rating", "minimum_pa"): guess if low < 0.0 else "0, to vent",
        ("rating", "maximum_pa"): guess,
    }
    regulator = data["regulator"]
    lowest, highest = regulator["minimum_pa"], regulator["maximum_pa"]
    for key, found, wanted in (
        ("minimum_pa", lowest, low if lowest == 0.0 else min(lowest, low)),
        ("maximum_pa", highest, high if highest == _SHIPPED else max(highest, high)),
    ):
        regulator[key] = wanted
        if wanted != found:
            own["regulator", key] = _OF_RANGE
    if data["family"] == "canopen_408" and high - low != _SHIPPED:
        for key in ("hysteresis_pa", "command_resolution_pa", "reading_resolution_pa", "reading_noise_pa"):
            if key in regulator:
                regulator[key] = rounded(regulator[key] * (high - low) / _SHIPPED)
                own["regulator", key] = "the same part of the range as there"
    if data["family"] == "canopen_408" and high > _SHIPPED:
        data["emulation"]["supply_pa"] = high + _SUPPLY_MARGIN
        own["emulation", "supply_pa"] = "60 kPa above the range"
    if data["family"] == "itv_rs232":
        data["full_scale_pa"] = next((scale for scale in _ITV_SCALES if scale >= high), _ITV_SCALES[-1])
    if data["family"] == "alicat" and high * RATING > data["emulation"]["full_scale_pa"]:
        data["emulation"]["full_scale_pa"] = rounded(high * RATING)
        own["emulation", "full_scale_pa"] = "the rating"
    return own


def _noted(
    data: Mapping[str, Any],
    model: BaseModel,
    name: str,
    own: Mapping[tuple[str, ...], str],
    path: tuple[str, ...],
) -> dict[str, Any]:
    """Return the values of a section with the descriptions of their keys.

    Parameters
    ----------
    data : mapping
    model : BaseModel
        The same, checked.
    name : str
        Shipped file that values come from.
    own : mapping
        Origin of the values that do not, by path.
    path : tuple of str
    """
    tree: dict[str, Any] = {}
    for key, value in data.items():
        part, here = getattr(model, key, None), (*path, key)
        if isinstance(value, Mapping) and isinstance(part, BaseModel):
            tree[key] = _noted(value, part, name, own, here)
        elif isinstance(value, list) and value and isinstance(value[0], Mapping):
            tree[key] = [Noted(item, f"{_TABLES.get(key, '')}as in {name}") for item in value]
        elif isinstance(value, Mapping):
            about = f"{_TABLES.get(key, '')}as in {name}"
            tree[key] = {inner: Noted(item, about) for inner, item in value.items()}
        else:
            field = type(model).model_fields.get(key)
            described = field.description if field is not None and field.description else ""
            number = isinstance(value, int | float) and not isinstance(value, bool)
            origin = own.get(here, f"as in {name}" if number else "")
            unit = _unit(key) if number and "[" not in described else ""
            about = ", ".join(part for part in (unit, described) if part)
            tree[key] = Noted(value, "; ".join(part for part in (about, origin) if part))
    return tree


def _unit(key: str) -> str:
    """Return the unit at the end of a name."""
    units = {"_pa_s": "Pa/s", "_pa": "Pa gauge", "_hz": "Hz", "_s": "s", "_sps": "1/s", "_v": "V"}
    return next((unit for end, unit in units.items() if key.endswith(end)), "")
