"""The table of public meshes: of what is there, and addresses of what is not."""

import sys

import pytest

from benchmarks.public_meshes import ADDRESSES, CASES, main
from tests.soro_design.fem.foreign import gmsh_vtk, net_of_tetrahedra


def test_a_mesh_that_is_there_is_solved_and_others_have_addresses(monkeypatch, capsys, tmp_path):
    pytest.importorskip("meshio", reason="needs the extra design: pip install 'soro[design]'")
    (tmp_path / "pneunetCutCoarse.vtk").write_text(gmsh_vtk(*net_of_tetrahedra()))
    (tmp_path / "Springy.vtk").write_text("no mesh")
    monkeypatch.setattr(sys, "argv", ["public_meshes", str(tmp_path), "--pressure-kpa", "1"])
    main()
    rows = capsys.readouterr().out.splitlines()
    assert [word.strip() for word in rows[2].split("|")][1:5:3] == ["pneunetCutCoarse.vtk", "15000"]
    assert "Springy.vtk" in rows[3]
    assert "allowed" in rows[3]
    assert len(rows) == 4 + len(ADDRESSES) - 2
    assert all(row.startswith(f"not in {tmp_path}: https://") for row in rows[4:])


def test_each_file_of_a_case_has_an_address():
    assert {name for case in CASES for name in (case.file, case.stl) if name} == set(ADDRESSES)
