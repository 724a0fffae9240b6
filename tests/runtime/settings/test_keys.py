import tomllib
from collections import Counter

import annotated_types
from pydantic import BaseModel

from docs.generate.configuration_page import TASKS, configuration_page, task_of, unit
from runtime.settings.configuration import Configuration, load_configuration, models_in
from runtime.settings.keys import distinct_keys, tables
from runtime.settings.not_keys import NOT_KEYS
from runtime.source_tree import CONFIG

MOST_KEYS = 126  # more than that nobody can own: a new one takes the place of one that no file sets
COLUMNS = 5
LEAST, MOST = {annotated_types.Ge, annotated_types.Gt}, {annotated_types.Le, annotated_types.Lt}


def test_there_are_no_more_keys_than_someone_can_own() -> None:
    assert len(distinct_keys()) <= MOST_KEYS


def test_every_table_belongs_to_a_task_and_none_to_two() -> None:
    named = Counter(path for paths in TASKS.values() for path in paths)
    assert set(named.values()) == {1}
    assert set(named) <= {table.path for table in tables()}
    assert {task_of(table.path) for table in tables()} == set(TASKS)


def test_the_page_shows_every_table_in_five_columns() -> None:
    page = configuration_page()
    rows = [line for line in page.splitlines() if line.startswith("|")]
    assert {line.replace("\\|", "").count("|") for line in rows} == {COLUMNS + 1}
    for table in tables():
        if table.path and any(table.leaves()) and ".right" not in table.path:
            assert f"[{table.path}]" in page


def test_a_number_has_a_range_and_every_key_a_description() -> None:
    for table in tables():
        for name, field in table.leaves():
            limits = {type(limit) for limit in field.metadata}
            number = field.annotation in (int, float, int | None, float | None)
            assert not number or (limits & LEAST and limits & MOST), f"{table.path}.{name} has no range"
            assert name == "kind" or field.description, f"{table.path}.{name}"


def test_the_unit_stands_in_the_name_of_a_length_and_a_time() -> None:
    assert (unit("max_speed_mps"), unit("gap_s"), unit("wheel_radius_left_m"), unit("particles")) == (
        "m/s",
        "s",
        "m",
        "",
    )


def test_fields_that_are_no_keys_are_fields_and_stand_in_no_configuration_that_is_written_down() -> None:
    written = tomllib.loads(load_configuration(CONFIG / "mock.toml").text)
    for path, names in NOT_KEYS.items():
        models: list[type[BaseModel]] = [Configuration]
        table = written
        for part in path.split("."):
            models = [
                inner
                for model in models
                if part in model.model_fields
                for inner in models_in(model.model_fields[part].annotation)
            ] or models
            table = table.get(part, {})
        assert any(names <= set(model.model_fields) for model in models), path
        assert not names & set(table), path
