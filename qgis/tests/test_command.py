"""What the plugin does without QGIS: it reads the help of the program, and runs it."""

from __future__ import annotations

import stat
import sys
import textwrap
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "qgis" / "satgs_qgis"))

import command  # noqa: E402

HELP = """\
Align a run to a reference: one shift of
its cameras

RUN/align.json records the shift.

Usage: satgs align [OPTIONS] --to <REFERENCE> <RUN>

Arguments:
  <RUN>
          Run folder

Options:
      --to <REFERENCE>
          Reference: a surface model
          or surveyed points
          
          It may lie anywhere.

      --overwrite
          Replace files

      --format <FORMAT>
          Files of the model

          Possible values:
          - bin:  binary
          - text: as text

Input:
  -k, --kind <KIND>
          Kind [default: a] [possible values: a, b-c]

Options of all commands:
      --json
          Print the summary

xyz is what follows the help

Examples:
  satgs align xyz
"""


def test_arguments_have_the_names_texts_and_values_of_the_help() -> None:
    found = command.parse_help(HELP)
    assert found.summary == "Align a run to a reference: one shift of its cameras"
    assert found.description == "RUN/align.json records the shift."
    run, to, overwrite, form, kind = found.arguments
    assert (run.name, run.option, run.value) == ("run", None, "RUN")
    assert (to.name, to.option, to.summary) == ("to", "--to", "Reference: a surface model or surveyed points")
    assert to.text.endswith("It may lie anywhere.")
    assert (overwrite.value, form.values, kind.values) == (None, ["bin", "text"], ["a", "b-c"])
    assert "xyz" not in kind.text


def test_values_become_words() -> None:
    arguments = command.parse_help(HELP).arguments
    values = {"run": "-odd name", "to": "a.tif", "overwrite": True, "format": "", "kind": None}
    assert command.words_of(arguments, values) == ["--to=a.tif", "--overwrite", "--", "-odd name"]
    assert command.words_of(arguments, {"run": "r", "overwrite": False}) == ["--", "r"]


def stand_in(folder: Path, body: str) -> str:
    """A program that does what `body` says."""
    path = folder / "satgs"
    path.write_text(f"#!{sys.executable}\nimport signal, sys, time\n" + textwrap.dedent(body))
    path.chmod(path.stat().st_mode | stat.S_IEXEC)
    return str(path)


def test_events_and_the_summary_arrive(tmp_path: Path) -> None:
    program = stand_in(
        tmp_path,
        """
        assert sys.argv[1:] == ["ba", "--events", "--quiet", "--", "scene"], sys.argv
        print('{"event": "started", "stage": "matching", "total": 2}', flush=True)
        print("no event")
        print('{"event": "advanced", "done": 1, "status": ""}')
        print('{"event": "summary", "summary": {"views": 3}}')
        """,
    )
    events: list[dict] = []
    assert command.run(program, ["ba", "--", "scene"], events.append, lambda: False) == {"views": 3}
    assert [event["event"] for event in events] == ["started", "advanced"]


def test_a_failure_says_what_the_program_said(tmp_path: Path) -> None:
    program = stand_in(tmp_path, "print('error: no scene', file=sys.stderr); sys.exit(2)")
    with pytest.raises(command.CommandError, match="error: no scene"):
        command.run(program, ["ba"], lambda event: None, lambda: False)
    with pytest.raises(command.CommandError, match="cannot be started"):
        command.run(str(tmp_path / "absent"), ["ba"], lambda event: None, lambda: False)
    assert command.help_of(str(tmp_path / "absent"), "ba") == command.Help()


def test_what_is_missing_of_a_partial_result_is_a_warning(tmp_path: Path) -> None:
    program = stand_in(
        tmp_path,
        """
        print('{"event": "summary", "summary": {"views": 2}}')
        print('error: one image is left out', file=sys.stderr)
        sys.exit(3)
        """,
    )
    events: list[dict] = []
    assert command.run(program, ["ba"], events.append, lambda: False) == {"views": 2}
    assert events == [{"event": "warning", "text": "error: one image is left out"}]


def test_a_command_that_is_cancelled_is_asked_to_stop(tmp_path: Path) -> None:
    program = stand_in(
        tmp_path,
        f"""
        def stop(*_):
            open({str(tmp_path / "checkpoint")!r}, "w").close()
            sys.exit(130)
        signal.signal(signal.SIGTERM, stop)
        print('{{"event": "finished"}}', flush=True)
        time.sleep(60)
        """,
    )
    began: list[dict] = []
    with pytest.raises(command.Cancelled):
        command.run(program, ["run"], began.append, lambda: bool(began))
    assert (tmp_path / "checkpoint").exists(), "it was not killed"


def test_the_help_of_the_program_is_understood() -> None:
    program = str(ROOT / "target" / "debug" / "satgs")
    if not Path(program).exists():
        pytest.skip("satgs is not built")
    names = {name: [a.name for a in command.help_of(program, name).arguments] for name in ["ba", "run", "dsm-eval", "changes", "align", "export"]}
    assert {"scene", "output", "gcps"} <= set(names["ba"])
    assert {"scene", "output", "truth", "dtm"} <= set(names["run"])
    assert {"dsm", "truth", "output"} <= set(names["dsm-eval"])
    assert {"run", "to"} <= set(names["align"])
    assert {"run", "3dtiles", "spz"} <= set(names["export"])
    assert not any("json" in found or "help" in found for found in names.values())
