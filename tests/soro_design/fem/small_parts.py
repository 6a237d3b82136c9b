"""Part files with few elements, for tests."""

import yaml

ROD = {
    "geometry": {
        "kind": "rod_with_chambers",
        "length_m": 0.06,
        "radius_m": 0.012,
        "chamber_radius_m": 0.004,
        "chamber_offset_m": 0.007,
        "plug_m": 0.003,
        "around": 2,
        "across": 1,
        "along": 6,
    },
    "material": "dragonskin_10",
    "sweeps": [{"name": "one", "pressures_pa": [1e3, 0.0, 0.0]}],
}
TUBE = {
    "geometry": {"kind": "tube", "length_m": 0.02, "inner_radius_m": 0.004, "outer_radius_m": 0.008},
    "material": "dragonskin_10",
    "sweeps": [{"name": "blown", "pressures_pa": [1e3]}],
}


def written(tmp_path, part, **changes):
    path = tmp_path / "part.yaml"
    path.write_text(yaml.safe_dump({**part, **changes}), encoding="utf-8")
    return path
