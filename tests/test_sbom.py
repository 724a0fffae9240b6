"""The bill of materials names every pin of the lock with the hashes of its files, and nothing of the day."""

from tests.support.locks import LOCKS, pins_of, read_facts
from tests.support.sbom import bill

PROJECT = {"name": "infant", "version": "1.2.3", "license": "Apache-2.0"}


def test_every_pin_is_a_component_with_all_its_hashes() -> None:
    lock = LOCKS[0].read_text(encoding="utf-8")
    made = bill(lock, PROJECT, read_facts())
    pins = pins_of(lock)
    assert len(made["components"]) == len(pins) > 20
    for pin, component in zip(pins, made["components"], strict=True):
        assert component["purl"].endswith(f"@{component['version']}")
        assert f"{component['name']}=={component['version']}" == pin.key
        hashes = {each["hashes"][0]["content"] for each in component["externalReferences"]}
        assert hashes == pin.hashes
    references = [component["bom-ref"] for component in made["components"]]
    assert made["dependencies"][0]["dependsOn"] == references
    assert len(set(references)) == len(references)


def test_the_same_lock_gives_the_same_bill_and_another_one_another() -> None:
    lock = "numpy==2.4.0 \\\n    --hash=sha256:00ff\n"
    assert bill(lock, PROJECT, {}) == bill(lock, PROJECT, {})
    assert bill(lock, PROJECT, {})["serialNumber"] != bill(lock.replace("00ff", "11ff"), PROJECT, {})["serialNumber"]
