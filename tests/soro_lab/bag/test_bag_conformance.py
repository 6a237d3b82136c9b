"""The conformance files of the MCAP format are read as their authors state, with the index and without."""

import json
from pathlib import Path

import pytest

from soro_lab.bag import BagReader, repair

KEPT = Path(__file__).parent / "conformance"
FILES = sorted(KEPT.glob("*.mcap"))


def stated(file: Path) -> dict[str, list[dict]]:
    """The fields of the records in the .json beside a file, by the kind of record."""
    result: dict[str, list[dict]] = {}
    for record in json.loads(file.with_suffix(".json").read_text())["records"]:
        fields = {name: plain(value) for name, value in record["fields"]}
        kind = result.setdefault(record["type"], [])
        if fields not in kind or record["type"] == "Message":
            kind.append(fields)  # the index repeats schemas and channels
    return result


def plain(value):
    """Numbers stand as texts there, and bytes as lists of them."""
    if isinstance(value, list):
        return bytes(int(item) for item in value)
    return int(value) if isinstance(value, str) and value.isdecimal() else value


def read(file: Path, index: bool) -> dict[str, list[dict]]:
    """The same of what the reader finds; messages in the order in which it gives them."""
    result: dict[str, list[dict]] = {}
    with BagReader(file, index) as reader:
        (part,) = reader.parts
        result["Header"] = [{"library": "", "profile": part.profile}]
        result["Schema"] = [vars(schema) for schema in part.schemas.values()]
        result["Channel"] = [vars(channel) for channel in part.channels.values()]
        result["Metadata"] = [{"name": name, "metadata": values} for name, values in part.metadata]
        result["Attachment"] = [vars(part.attachment(item)) for item in part.attachments]
        ids = {channel.topic: channel.id for channel in part.channels.values()}
        result["Message"] = [
            {
                "channel_id": ids[item.topic],
                "sequence": item.sequence,
                "log_time": item.log_time_ns,
                "publish_time": item.publish_time_ns,
                "data": item.data,
            }
            for item in reader.messages()
        ]
        assert reader.problems == ()
        assert reader.message_count == len(result["Message"])
    return {kind: records for kind, records in result.items() if records}


def assert_is_read(file: Path) -> None:
    expected = stated(file)
    expected.get("Message", []).sort(key=lambda item: item["log_time"])
    wanted = {kind: records for kind, records in expected.items() if kind in KINDS}
    for index in (True, False):
        assert read(file, index) == wanted, (file.name, index)


KINDS = ("Header", "Schema", "Channel", "Metadata", "Attachment", "Message")


def test_the_kept_files_are_all_there():
    assert len(FILES) == 36


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_a_file_is_read_alike_with_the_index_and_without(file):
    assert_is_read(file)


def test_all_files_are_read_alike_with_the_index_and_without(data):
    root = data / "mcap_conformance"
    if not root.is_dir():
        pytest.skip(f"no conformance files in {root}")
    files = sorted(root.rglob("*.mcap"))
    assert len(files) == 416
    for file in files:
        assert_is_read(file)


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_a_repaired_file_says_the_same(tmp_path, file):
    copy = tmp_path / "bag.mcap"
    copy.write_bytes(file.read_bytes())
    before = read(file, index=False)
    (part,) = repair(copy)
    assert part.original is None
    assert read(copy, index=True) == before
    assert [item.rewritten for item in repair(copy)] == [False]
