"""Part files whose mesh is a file, for tests."""

import pytest

from soro_design.fem.meshes.blocks import block, revolved_tube
from soro_design.fem.meshes.vtu import write_vtu

# A tube as `small_parts.TUBE`, of its own mesh.
TUBE_MESH = {
    "kind": "mesh",
    "file": "tube.vtu",
    "space": "axisymmetric",
    "regions": {"base": {"y_m": [0.0, 0.0]}, "top": {"y_m": [0.02, 0.02]}, "inside": {"x_m": [0.004, 0.004]}},
    "held": [{"region": "base", "directions": "y"}],
    "pressed": [{"region": "inside"}],
    "moved": {"region": "top", "direction": "y"},
}
# A beam of 10 x 10 x 40 mm, clamped at z = 0.
BEAM_MESH = {
    "kind": "mesh",
    "file": "beam.vtu",
    "regions": {"base": {"z_m": [0.0, 0.0]}, "end": {"z_m": [0.04, 0.04]}, "side": {"x_m": [0.01, 0.01]}},
    "held": [{"region": "base", "directions": "xyz"}],
    "forced": "end",
}
PULL = {"name": "pull", "force_n": [0.0, 0.0, 0.1], "states": 1}
BLOWN = {"name": "blown", "pressures_pa": [1e3], "states": 1}
TUBE_PART = {"geometry": TUBE_MESH, "material": "dragonskin_10", "sweeps": [BLOWN]}
BEAM_PART = {"geometry": BEAM_MESH, "material": "dragonskin_10", "sweeps": [PULL]}


def meshes(folder):
    """Write the meshes of both parts into a folder; skip a test that cannot read them."""
    pytest.importorskip("meshio", reason="needs the extra design: pip install 'soro[design]'")
    write_vtu(folder / "tube.vtu", revolved_tube("quad4", (4, 12), (0.004, 0.008), 0.02))
    write_vtu(folder / "beam.vtu", block("hex8", "solid", (2, 2, 10), (0.01, 0.01, 0.04)))
