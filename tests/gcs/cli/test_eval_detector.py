"""``gcs eval-detector`` refuses before it looks at an image what it would refuse afterwards."""

from tests.support.command_line import run_gcs


def test_results_are_never_written_over_others(tmp_path):
    (tmp_path / "eval.md").write_text("of another model")
    code, _, told = run_gcs("eval-detector", tmp_path / "no images here", "-o", tmp_path)
    assert (code, told) == (
        2,
        f"gcs: {tmp_path / 'eval.md'}: exists already and is never overwritten; give another folder\n",
    )


def test_a_model_to_compare_with_must_be_there(tmp_path):
    code, _, told = run_gcs("eval-detector", tmp_path / "no images here", "--against", tmp_path / "no.onnx")
    assert code == 2
    assert told.startswith(f"gcs: {tmp_path / 'no.onnx'}: no such model file")
