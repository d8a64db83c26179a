"""The view of a shoot: photographs, the file as a form, and who may hand over what."""

import shutil
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from bundled_shoot import DEMO
from view_makers import Client, served, with_first_photographs_swapped

from lensfit.workflow.check.session import CheckSession
from lensfit.workflow.shoot.shoot_file import load_shoot
from lensfit.workflow.view.loopback_server import MOST_BYTES
from lensfit.workflow.view.shoot_server import LARGEST_BYTES, ShootServer
from lensfit.workflow.view.viewed_shoot import ViewedShoot

PATIENCE_S = 120.0


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    shutil.copy(DEMO / "shoot.toml", tmp_path)
    return tmp_path


@pytest.fixture
def client(folder: Path) -> Iterator[Client]:
    viewed = ViewedShoot(folder / "shoot.toml", None, folder / "results")
    with served(ShootServer(viewed)) as asked:
        yield asked


def until(found: Callable[[], Any], patience_s: float = PATIENCE_S) -> Any:
    deadline = time.monotonic() + patience_s
    while not (value := found()):
        assert time.monotonic() < deadline
        time.sleep(0.1)
    return value


def photographs(client: Client) -> list[dict]:
    return client.get("api/checks").json()["photographs"]


def fields(form: dict, table: str, place: int | None = None) -> dict[str, dict]:
    mine = next(t for t in form["tables"] if (t["table"], t["place"]) == (table, place))
    return {one["key"]: one for one in mine["fields"]}


def test_the_form_is_the_file(client: Client, folder: Path):
    form = client.get("api/shoot").json()
    shoot = load_shoot(folder / "shoot.toml")
    assert fields(form, "lens")["name"]["value"] == shoot.lens.name
    assert form["fault"] is None
    for place, take in enumerate(shoot.takes):
        mine = fields(form, "take", place)
        assert mine["image"]["value"] == take.image
        assert float(mine["f_number"]["value"]) == take.f_number
    assert "dot-grid" in fields(form, "target", 0)["kind"]["choices"]


def test_a_field_is_set_in_the_file_and_what_is_wrong_has_its_place(
    client: Client, folder: Path
):
    path = folder / "shoot.toml"
    before = path.read_text()
    answer = client.post("field", table="take", place=1, key="f_number", typed="4")
    assert answer.status == 200
    assert load_shoot(path).takes[1].f_number == 4
    assert fields(answer.json(), "take", 1)["f_number"]["value"] == "4"
    lengths = client.post("field", table="take", place=1, key="focus_distance_mm",
                          typed="2 m")  # fmt: skip
    assert lengths.status == 200
    assert load_shoot(path).takes[1].focus_distance_mm == 2000
    written = path.read_text()
    assert written != before
    for typed, place, key in (
        ("-2", 1, "f_number"), ("20", 1, "focus_distance_mm"), ("", 0, "image"),
        ("no such", 0, "target"), ("[9, 9, 1, 1]", 0, "roi"),
    ):  # fmt: skip
        refused = client.post("field", table="take", place=place, key=key, typed=typed)
        assert refused.status == 422, key
        said = refused.json()
        assert (said["table"], said["place"], said["key"]) == ("take", place, key)
        assert "[[" not in said["error"]
        assert not said["error"].startswith(f"{key}:")
        assert len(said["error"].split()) > 3
    refused = client.post("field", table="target", place=0, key="kind", typed="dots")
    assert refused.json()["key"] == "kind"
    assert path.read_text() == written


@pytest.mark.parametrize("name", ["field", "remove"])
def test_nothing_is_written_into_another_photograph(
    client: Client, folder: Path, name: str
):
    path = folder / "shoot.toml"
    image = load_shoot(path).takes[0].image
    path.write_text(with_first_photographs_swapped(path.read_text()))
    before = path.read_text()
    meant = {"table": "take", "place": 0, "named": image}
    typed = {"key": "f_number", "typed": "7"} if name == "field" else {}
    refused = client.post(name, **meant, **typed)
    assert refused.status == 409
    assert image in refused.json()["error"]
    assert path.read_text() == before
    assert client.post(name, **meant | {"place": 1}, **typed).status == 200
    gone = client.post(name, **meant | {"place": 99}, **typed)
    assert gone.status == 409


def test_a_fault_of_the_file_stands_in_the_form(client: Client, folder: Path):
    path = folder / "shoot.toml"
    text = path.read_text()
    path.write_text(text.replace("sensor_width_mm =", "sensor_widht_mm ="))
    fault = client.get("api/shoot").json()["fault"]
    assert "sensor_width_mm" in fault["error"]
    assert fault["table"] == "camera"
    path.write_text(text.replace("[lens]", "[lens"))
    form = client.get("api/shoot").json()
    assert "TOML" in form["fault"]["error"]
    assert form["tables"] == []


def test_the_plan_follows_the_file(client: Client, folder: Path):
    path = folder / "shoot.toml"
    text = path.read_text()
    images = [take.image for take in load_shoot(path).takes]
    path.write_text(text.replace(images[0], "renamed.exr"))
    client.get("api/shoot")
    renamed = ["renamed.exr", *images[1:]]
    planned = client.get("api/checks").json()["plan"]
    assert [view["image"] for view in planned] == renamed
    path.write_text(text.replace("[lens]", "[lens"))
    client.get("api/shoot")
    assert client.get("api/checks").json()["plan"] == planned


def test_paths_are_whole(folder: Path, monkeypatch: pytest.MonkeyPatch):
    """A folder that is said to be "." names nothing."""
    monkeypatch.chdir(folder)
    viewed = ViewedShoot(Path("shoot.toml"), None, Path("results"))
    with served(ShootServer(viewed)) as client:
        assert client.get("api/checks").json()["folder"] == str(folder)
        form = client.get("api/shoot").json()
    assert form["path"] == str(folder / "shoot.toml")
    assert form["out"] == str(folder / "results")


def test_fields_are_named_for_people(client: Client):
    form = client.get("api/shoot").json()
    take, target = fields(form, "take", 0), fields(form, "target", 0)
    assert take["f_number"]["label"] == "f-number"
    assert "look" in take["roi"]["label"]
    assert "row" in target["asymmetric"]["label"]


def test_charts_and_photographs_come_and_go(client: Client, folder: Path):
    path = folder / "shoot.toml"
    whole = load_shoot(path)
    assert client.post("target").status == 200
    assert len(load_shoot(path).targets) == len(whole.targets) + 1
    assert client.post("remove", table="take", place=0).status == 200
    assert [t.image for t in load_shoot(path).takes] == [
        t.image for t in whole.takes[1:]
    ]
    for message in ({"table": "take", "place": 99}, {"table": "lens", "place": 0}):
        assert client.post("remove", **message).status == 422
    assert client.post("remove", table="target", place=0).status == 422
    assert len(load_shoot(path).takes) == len(whole.takes) - 1


def test_a_photograph_handed_over_is_checked_as_check_does(
    client: Client, folder: Path
):
    content = (DEMO / "dots.exr").read_bytes()
    assert client.upload("dots.exr", content).status == 200
    assert (folder / "dots.exr").read_bytes() == content
    found = until(lambda: photographs(client))[0]
    shoot = load_shoot(folder / "shoot.toml")
    judged = CheckSession(shoot).check(folder / "dots.exr")
    assert found["level"] == judged.level
    assert found["points"] == judged.points > 100
    assert found["covered"] == judged.coverage.share
    assert [p["text"] for p in found["problems"]] == [p.text for p in judged.problems]
    state = client.get("api/checks").json()
    assert "missing" in state["next"]
    assert [v["image"] for v in state["plan"] if v["state"] != "missing"] == [
        "dots.exr"
    ]
    picture = client.get("api/picture/0")
    assert picture.content.startswith(b"\x89PNG")
    assert client.get("api/picture/7").status == 422


def test_photographs_that_the_file_lacks_are_drafted_into_it(tmp_path: Path):
    viewed = ViewedShoot(tmp_path / "shoot.toml", None, tmp_path / "results")
    with served(ShootServer(viewed)) as client:
        assert client.get("api/shoot").json()["is_there"] is False
        refused = client.post("draft").json()["error"]
        assert "no photograph" in refused
        for count, name in enumerate(("dots.exr", "lines.jpg"), 1):
            shutil.copy(DEMO / name, tmp_path)
            until(
                lambda c=count: len(client.get("api/checks").json()["photographs"]) == c
            )
            form = client.post("draft").json()
            assert fields(form, "take", count - 1)["image"]["value"] == name
        assert form["unconfirmed"]
        shoot = load_shoot(tmp_path / "shoot.toml")
        assert [take.image for take in shoot.takes] == ["dots.exr", "lines.jpg"]
        assert "[[target]] 1, kind" in form["unconfirmed"]
        answer = client.post("field", table="target", place=0, key="kind",
                             typed="dot-grid")  # fmt: skip
        assert "[[target]] 1, kind" not in answer.json()["unconfirmed"]


def write_grey(path: Path) -> None:
    cv2.imwrite(str(path), np.full((200, 300), 127, np.uint8))


def test_a_photograph_without_a_chart_is_not_drafted(client: Client, folder: Path):
    path = folder / "shoot.toml"
    before = path.read_text()
    write_grey(folder / "grey.png")
    until(lambda: photographs(client))
    refused = client.post("draft")
    assert refused.status == 422
    assert "no chart was found on grey.png" in refused.json()["error"]
    assert path.read_text() == before
    shutil.copy(DEMO / "dots.exr", folder / "another.exr")
    until(lambda: len(photographs(client)) == 2)
    form = client.post("draft").json()
    images = [take.image for take in load_shoot(path).takes]
    assert "another.exr" in images
    assert "grey.png" not in images
    assert form["left_out"] == ["grey.png"]


def test_a_deleted_photograph_is_listed_no_more(client: Client, folder: Path):
    write_grey(folder / "grey.png")
    until(lambda: photographs(client))
    shutil.copy(DEMO / "dots.exr", folder)
    until(lambda: len(photographs(client)) == 2)
    state = client.get("api/checks").json()
    assert "done" in [view["state"] for view in state["plan"]]
    picture = photographs(client)[1]["picture"]
    (folder / "grey.png").unlink()
    assert [one["name"] for one in photographs(client)] == ["dots.exr"]
    assert photographs(client)[0]["picture"] == picture
    (folder / "dots.exr").unlink()
    state = client.get("api/checks").json()
    assert state["photographs"] == []
    assert {view["state"] for view in state["plan"]} == {"missing"}


@pytest.mark.parametrize(
    "name",
    [
        "../dots.exr", "/etc/x.exr", "a/b.exr", "..\\x.exr", ".hidden.exr", "x.toml",
        "x", "", "x.exr\n", "a" * 300 + ".exr", "x.py",
    ],
)  # fmt: skip
def test_no_other_file_is_written(client: Client, folder: Path, name: str):
    before = {p.relative_to(folder) for p in folder.rglob("*")}
    answer = client.upload(name, b"x")
    assert answer.status == 422
    assert {p.relative_to(folder) for p in folder.rglob("*")} == before


def test_nothing_is_replaced_and_no_part_stays(client: Client, folder: Path):
    (folder / "dots.exr").write_bytes(b"mine")
    assert client.upload("dots.exr", b"theirs").status == 422
    assert (folder / "dots.exr").read_bytes() == b"mine"
    over = client.upload("far.png", b"", **{"Content-Length": str(LARGEST_BYTES + 1)})
    assert over.status == 413
    assert client.post_bytes("field", b" " * (MOST_BYTES + 1)).status == 413
    assert not list(folder.glob(".arriving*"))
    assert not (folder / "far.png").exists()
    wrong = client.ask(
        "POST", f"/{client.token}/api/photograph?name=x.exr", b"x",
        {"content-type": "multipart/form-data"},
    )  # fmt: skip
    assert wrong.status == 422


def test_what_is_no_photograph_is_said(client: Client):
    assert client.upload("broken.png", b"no picture").status == 200
    found = until(lambda: photographs(client))[0]
    assert "broken.png" in found["failed"]
    assert found["level"] == "bad"


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("field", {"table": "take", "key": "__class__", "typed": "x"}),
        ("field", {"table": "defaults", "key": "f_number", "typed": "x"}),
        ("field", {"table": "take", "place": 99, "key": "f_number", "typed": "2"}),
        ("field", {"table": "lens", "key": "name = 1\n[x]\ny", "typed": "2"}),
        ("calibrate", {"effort": "most"}),
        ("calibrate", {"out": "/etc"}),
        ("draft", {"path": "/etc/passwd"}),
    ],
)
def test_what_cannot_be_is_a_sentence(client: Client, name: str, message: dict):
    answer = client.post(name, **message)
    assert answer.status == 422
    assert "\n" not in answer.json()["error"]
