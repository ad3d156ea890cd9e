import json
from pathlib import Path

from crfbench import lab


def test_notebooks_are_copied_once_and_never_overwritten(tmp_path):
    copied = lab.copy_notebooks(tmp_path / "mine")
    assert lab.START in {path.name for path in copied}
    mine = tmp_path / "mine" / lab.START
    mine.write_text("changed by the user")
    (tmp_path / "mine" / "1-response-curves.ipynb").unlink()
    assert [path.name for path in lab.copy_notebooks(tmp_path / "mine")] == ["1-response-curves.ipynb"]
    assert mine.read_text() == "changed by the user"


def test_jupyterlab_listens_here_only_and_keeps_its_token(tmp_path, monkeypatch):
    seen = []
    monkeypatch.setattr("jupyterlab.labapp.main", seen.append)
    lab.open_lab(tmp_path, ["--no-browser"])
    (command,) = seen
    assert "--ServerApp.ip=127.0.0.1" in command
    assert f"--ServerApp.root_dir={tmp_path}" in command
    assert f"--LabApp.default_url=/lab/tree/{lab.START}" in command
    assert command[-1] == "--no-browser"
    assert not any("token" in word or "password" in word for word in command)


def test_environment_and_data_tables():
    environment = lab.environment_table()
    assert environment["fits"].all()
    assert {"numpy", "jupyterlab", "anywidget"} <= set(environment["package"])
    assert "torch" not in set(environment["package"])
    data = lab.data_table().set_index("key")
    assert data.loc["opencrf", "present"] == "bundled"
    assert "where" not in data


def test_scripts_of_the_environment_are_no_modules():
    """JupyterLab asks one in .venv, below package.json, and shows all its text where Node takes it for a module."""
    root = Path(__file__).parents[1]
    assert "type" not in json.loads((root / "package.json").read_text(encoding="utf-8"))
