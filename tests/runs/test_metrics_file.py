"""The rows of ``metrics.csv``, and those that a resumed run keeps."""

import pytest

from locomotion.runs import RunError
from locomotion.runs.metrics import MetricsWriter

ROWS = [
    {"iteration": i, "frames": 8 * (i + 1), "mean_reward": 0.1 * i, "mean_value": -1 / 3}
    for i in range(4)
]
TEXT = """\
iteration,frames,mean_reward,mean_value
0,8,0,-0.333333333
1,16,0.1,-0.333333333
2,24,0.2,-0.333333333
3,32,0.3,-0.333333333
"""


def write(folder, rows, kept=0):
    writer = MetricsWriter(folder, kept)
    for row in rows:
        writer.write(row)
    writer.sync()
    writer.close()
    return (folder / "metrics.csv").read_text()


def test_rows_are_written_with_nine_digits(tmp_path):
    assert write(tmp_path, ROWS) == TEXT


@pytest.mark.parametrize("kept", [0, 1, 3])
@pytest.mark.parametrize("rest", ["", "3,3", "gecko\n"])
def test_a_resumed_run_keeps_as_many_as_it_had(tmp_path, kept, rest):
    lines = TEXT.splitlines(keepends=True)
    (tmp_path / "metrics.csv").write_text("".join(lines[: kept + 2]) + rest)
    assert write(tmp_path, ROWS[kept:], kept) == TEXT


@pytest.mark.parametrize("content", [None, "", TEXT[:60], TEXT[: TEXT.index("2,24") - 1]])
def test_rows_that_are_lost_are_named_and_the_file_left_alone(tmp_path, content):
    path = tmp_path / "metrics.csv"
    if content is not None:
        path.write_text(content)
    with pytest.raises(RunError, match=r"metrics\.csv has lost rows: .* written after 2"):
        MetricsWriter(tmp_path, 2)
    assert content is None or path.read_text() == content


def test_what_a_row_lacks_is_nan_and_what_is_new_has_no_column(tmp_path):
    rows = [{"iteration": 0, "loss": 1.5}, {"iteration": 1, "other": 2.5}]
    assert write(tmp_path, rows) == "iteration,loss\n0,1.5\n1,nan\n"
