"""metadata.yaml against its written form, against a real Jazzy recording, and in its older versions."""

import pytest
import yaml
from bag_samples import TOPICS, random_messages, write_bag

from soro_core.errors import BagError
from soro_lab.bag import INFINITE_NS, BagReader, Qos, Span
from soro_lab.bag.metadata import FilePart, Metadata, dump, dump_record, parse, parse_record
from soro_lab.bag.topics import qos_from, qos_to_yaml
from tests.refused import fails

GOLDEN = """\
rosbag2_bagfile_information:
  version: 9
  storage_identifier: mcap
  duration:
    nanoseconds: 1500000000
  starting_time:
    nanoseconds_since_epoch: 1700000000123456789
  message_count: 3
  topics_with_message_count:
    - topic_metadata:
        name: /chambers/state
        type: sensor_msgs/msg/JointState
        serialization_format: cdr
        offered_qos_profiles:
          - history: keep_last
            depth: 10
            reliability: reliable
            durability: volatile
            deadline:
              sec: 9223372036
              nsec: 854775807
            lifespan:
              sec: 9223372036
              nsec: 854775807
            liveliness: automatic
            liveliness_lease_duration:
              sec: 9223372036
              nsec: 854775807
            avoid_ros_namespace_conventions: false
        type_description_hash: RIHS01_a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e
      message_count: 3
    - topic_metadata:
        name: /never
        type: std_msgs/msg/Float64MultiArray
        serialization_format: cdr
        offered_qos_profiles: []
        type_description_hash: HASH_OF_FLOAT64_MULTI_ARRAY
      message_count: 0
  compression_format: ''
  compression_mode: ''
  relative_file_paths:
    - run_0.mcap
  files:
    - path: run_0.mcap
      starting_time:
        nanoseconds_since_epoch: 1700000000123456789
      duration:
        nanoseconds: 1500000000
      message_count: 3
  custom_data:
    scene: track_circle
  ros_distro: jazzy
"""


def example() -> Metadata:
    start, duration = 1_700_000_000_123_456_789, 1_500_000_000
    return Metadata(
        topics=((TOPICS[0], 3), (TOPICS[3], 0)),
        files=(FilePart("run_0.mcap", start, duration, 3),),
        start_ns=start,
        duration_ns=duration,
        message_count=3,
        custom_data={"scene": "track_circle"},
    )


def test_written_form():
    assert dump(example()) == GOLDEN.replace("HASH_OF_FLOAT64_MULTI_ARRAY", TOPICS[3].type_hash)


def test_what_is_written_is_read():
    read = parse(dump(example()), "metadata.yaml")
    assert (read.start_ns, read.duration_ns, read.message_count) == (
        1_700_000_000_123_456_789,
        1_500_000_000,
        3,
    )
    assert read.files == example().files
    assert read.custom_data == {"scene": "track_circle"}
    assert [(item.name, item.type, item.type_hash, item.qos) for item, _ in read.topics] == [
        (item.name, item.type, item.type_hash, item.qos) for item, _ in example().topics
    ]


def test_a_real_jazzy_recording_says_the_same_in_the_same_form(data):
    """The recorder of Jazzy left its metadata in the file: as it began and as it ended."""
    path = data / "mcap_compat" / "data" / "cub_stabilize_2025_11_13.mcap"
    with BagReader(path, index=False) as reader:
        texts = [
            values["serialized_metadata"] for name, values in reader.parts[0].metadata if name == "rosbag2"
        ]
    assert len(texts) == 2
    for text in texts:
        ours = dump_record(parse_record(text, "record"))
        assert yaml.safe_load(ours) == yaml.safe_load(text)
        assert list(yaml.safe_load(ours)) == list(yaml.safe_load(text))


def test_the_record_in_the_file_is_the_file_beside_it(tmp_path):
    bag = write_bag(tmp_path / "run", random_messages(3, 50))
    with BagReader(bag, index=False) as reader:
        begin, end = (yaml.safe_load(values["serialized_metadata"]) for _, values in reader.parts[0].metadata)
    assert end == yaml.safe_load((bag / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert begin["message_count"] == 0
    assert begin["starting_time"]["nanoseconds_since_epoch"] == 2**63 - 1


def test_metadata_of_all_versions_is_read(data):
    found = {}
    for path in sorted((data / "mcap_compat").rglob("metadata.yaml")):
        read = parse(path.read_text(), str(path))
        found[read.version] = read
        assert read.message_count == sum(count for _, count in read.topics)
    assert set(found) >= {2, 4, 6, 7, 8}
    by_name = {item.name: item for item, _ in found[8].topics}
    assert by_name["/test_topic1"].qos == (Qos("unknown", 0, "reliable", "volatile"),)
    assert by_name["/test_service1/_service_event"].qos[0].durability == "transient_local"
    assert by_name["/test_topic1"].type_hash.startswith("RIHS01_eee555")


def test_quality_of_service_by_number_and_by_name():
    text = qos_to_yaml([Qos("keep_all", 0, "best_effort", "transient_local", deadline=Span(1, 500_000_000))])
    assert qos_from(text)[0].deadline.nanoseconds == 1_500_000_000
    numbers = yaml.safe_load(text)
    numbers[0].update(history=2, reliability=2, durability=1, liveliness=1)
    assert qos_from(numbers) == qos_from(yaml.safe_dump(numbers)) == qos_from(text)
    assert qos_from("") == qos_from(None) == qos_from([]) == qos_from("[]") == ()
    old = {"sec": 0x7FFFFFFF, "nsec": 0xFFFFFFFF}
    assert qos_from([{"deadline": old}])[0].deadline == Span(**old)
    assert Span(**old).nanoseconds == Span().nanoseconds == INFINITE_NS


@pytest.mark.parametrize("value", ["{", "3", 7, [1], [{"deadline": 3}], [{"depth": "x"}]])
def test_wrong_quality_of_service(value):
    with fails(BagError, file="a.yaml", place="offered_qos_profiles", code="value"):
        qos_from(value, "a.yaml")


@pytest.mark.parametrize(
    ("change", "code", "names"),
    [
        (lambda text: "a: [", "damaged", ("YAML",)),
        (lambda text: "", "value", ("rosbag2_bagfile_information",)),
        (lambda text: "- 1", "value", ("rosbag2_bagfile_information",)),
        (lambda text: "rosbag2_bagfile_information: 3", "value", ("TypeError",)),
        (lambda text: text.replace("version: 9", "version: 10"), "format", ("version", "10", "9")),
        (lambda text: text.replace("version: 9", "version: x"), "value", ("ValueError",)),
        (lambda text: text.replace("\n  message_count: 3\n", "\n"), "value", ("message_count",)),
        (lambda text: text.replace("        name:", "        nam:"), "value", ("'name'",)),
        (lambda text: text.replace("sec: 9223372036", "sec: much"), "value", ("much",)),
    ],
)
def test_wrong_metadata(change, code, names):
    with fails(BagError, *names, file="metadata.yaml", code=code):
        parse(change(dump(example())), "metadata.yaml")
