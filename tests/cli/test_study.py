"""A study by commands: each one's output is the next one's input; no file is overwritten."""

import csv
import re
import subprocess
import sys
from pathlib import Path

import pytest

from stepblocks.cli import main

ROOT = Path(__file__).resolve().parents[2]
FOUR, TEN = (str(ROOT / "stimuli" / f"{name}.toml") for name in ("paper-four", "paper-ten"))


def run(capsys, *arguments):
    code = main(["study", *map(str, arguments)])
    printed = capsys.readouterr()
    return code, printed.out, printed.err


def table(path):
    with path.open(newline="") as stream:
        return list(csv.DictReader(stream))


@pytest.fixture
def folder(tmp_path, capsys):
    assert (
        run(
            capsys,
            "design",
            FOUR,
            "--participants",
            6,
            "--repetitions",
            2,
            "--seed",
            1,
            "-o",
            tmp_path / "s",
        )[0]
        == 0
    )
    return tmp_path / "s"


@pytest.mark.long
def test_from_the_block_set_to_the_report(folder, capsys):
    code, out, _ = run(capsys, "sheet", folder)
    assert (code, len(list((folder / "sheets").iterdir()))) == (0, 6)
    answers = folder / "answers.csv"
    simulate = [
        "simulate",
        folder,
        FOUR,
        "--damping",
        "soft=0.4",
        "--noise",
        "3 um",
        "--seed",
        2,
        "-o",
        answers,
    ]
    assert run(capsys, *simulate)[0] == 0
    code, out, _ = run(capsys, "analyse", folder, answers, "-o", folder / "report")
    assert code == 0
    assert "144 judgements of 6 participants" in out
    rows = [row for row in table(folder / "report" / "results.csv") if row["measure"] == "bias"]
    found = {(row["analysis"], row["quantity"]): row for row in rows}
    assert float(found["tukey", "bare minus soft"]["low_95"]) > 5.0
    assert (
        float(found["tukey", "bare minus hard"]["low_95"])
        < 0.0
        < float(found["tukey", "bare minus hard"]["high_95"])
    )
    assert float(found["mixed model", "condition, partial eta squared"]["p"]) < 1e-3
    page = (folder / "report" / "report.html").read_text()
    assert page.count("<svg") == 2
    # nothing is loaded, from the network or elsewhere
    assert not re.findall(r'(?:src|href)="(?!#)', page)
    first = {path.name: path.read_bytes() for path in (folder / "report").glob("*.*")}
    assert run(capsys, "analyse", folder, answers, "-o", folder / "again")[0] == 0
    assert {path.name: path.read_bytes() for path in (folder / "again").glob("*.*")} == first
    figures = folder / "report" / "figures"
    for name in ("estimates", "participants"):
        for form in ("svg", "pdf", "csv"):
            drawn = (figures / f"{name}.{form}").read_bytes()
            assert drawn == (folder / "again" / "figures" / f"{name}.{form}").read_bytes()


def test_codes_stand_for_the_engraved_identities(folder):
    key = {(row["participant"], row["code"]): row["engraved"] for row in table(folder / "key.csv")}
    assert sorted(set(key.values())) == [
        "APPARATUS-025",
        "APPARATUS-050",
        "APPARATUS-075",
        "APPARATUS-100",
    ]
    assert all(
        key[row["participant"], row["code"]] == row["engraved"]
        for row in table(folder / "design.csv")
    )
    own = [{code for who, code in key if who == one} for one in ("1", "2")]
    assert own[0] != own[1]  # codes say nothing from one participant to the next


def test_filled_in_sheets_are_analysed_and_never_overwritten(folder, capsys):
    run(capsys, "sheet", folder)
    answers = folder / "answers.csv"
    run(capsys, "simulate", folder, FOUR, "--seed", 2, "-o", answers)
    given = {(row["participant"], row["trial"]): row for row in table(answers)}
    for path in (folder / "sheets").iterdir():
        rows = [row | given[row["participant"], row["trial"]] for row in table(path)]
        path.write_text(
            "\n".join([",".join(rows[0]), *(",".join(row.values()) for row in rows)]) + "\n"
        )
    filled = {path: path.read_bytes() for path in sorted((folder / "sheets").iterdir())}
    code, _, err = run(capsys, "sheet", folder)
    assert (code, "has another content already" in err) == (2, True)
    assert {path: path.read_bytes() for path in filled} == filled
    assert run(capsys, "design", FOUR, "--seed", 99, "-o", folder)[0] == 2
    assert run(capsys, "analyse", folder, *filled, "-o", folder / "report")[0] == 0
    code, _, err = run(
        capsys, "analyse", folder, *filled, next(iter(filled)), "-o", folder / "report"
    )
    assert (code, "must occur once" in err, len(err.splitlines())) == (2, True, 1)


@pytest.mark.long
@pytest.mark.parametrize(
    ("options", "figures", "quantity"),
    [
        (
            ["--experiment", "virtual", "--repetitions", "1"],
            3,
            "realism: odds of a higher rating, vibration-on over vibration-off",
        ),
        (
            ["--experiment", "constant", "--standard", "step-050", "--repetitions", "2"],
            1,
            "population, Weber fraction of the height",
        ),
        (
            ["--experiment", "magnitude", "--repetitions", "1"],
            1,
            "exponent of the height, mean of participants",
        ),
    ],
)
def test_every_experiment_goes_all_the_way(tmp_path, capsys, options, figures, quantity):
    assert (
        run(capsys, "design", TEN, *options, "--participants", 6, "--seed", 1, "-o", tmp_path)[0]
        == 0
    )
    assert run(capsys, "sheet", tmp_path)[0] == 0
    answers = tmp_path / "answers.csv"
    assert (
        run(capsys, "simulate", tmp_path, TEN, "--weber", "0.5", "--seed", 2, "-o", answers)[0] == 0
    )
    assert run(capsys, "analyse", tmp_path, answers, "-o", tmp_path / "report")[0] == 0
    assert (tmp_path / "report" / "report.html").read_text().count("<svg") == figures
    assert quantity in {row["quantity"] for row in table(tmp_path / "report" / "results.csv")}


@pytest.mark.long
def test_power_rises_with_the_damping(tmp_path, capsys):
    common = [
        FOUR,
        "--participants",
        "4",
        "--repetitions",
        "1",
        "--analysis",
        "f-test",
        "--runs",
        "20",
        "--seed",
        "3",
        "-o",
        tmp_path / "p.csv",
    ]
    powers = []
    for soft in ("1", "0.3"):
        assert run(capsys, "power", *common, "--damping", f"bare=1,soft={soft}")[0] == 0
        powers.append(float(table(tmp_path / "p.csv")[0]["power_ratio"]))
    assert powers[0] < 0.3 < powers[1]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["sheet", "no-such-folder"], "a folder that 'stepblocks study design' wrote"),
        (
            ["design", str(ROOT / "stimuli" / "probe-tips.toml"), "--seed", "1", "-o", "x"],
            "needs step blocks",
        ),
        (
            ["design", FOUR, "--experiment", "constant", "--seed", "1", "-o", "x"],
            "standard must be one of",
        ),
        (["power", FOUR, "--seed", "1"], "at least two conditions"),
        (
            ["power", FOUR, "--damping", "a=1,b=1", "--friction", "0.5", "--seed", "1"],
            "apparatus-075 is locked",
        ),
    ],
)
def test_what_cannot_be_is_said_in_one_line(arguments, message, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, _, err = run(capsys, *arguments)
    assert (code, len(err.splitlines())) == (2, 1)
    assert message in err


def test_help_of_the_study_imports_nothing_heavy():
    code = (
        "import sys; from stepblocks.cli import main; main(['study', 'power', '--help'])\n"
        "print(sorted({'numpy', 'pandas', 'scipy', 'statsmodels', 'joblib', 'matplotlib'}"
        " & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ["design", "f", "--seed", "1.5", "-o", "x"],
            "error: --seed: must be a whole number",
        ),
        (
            ["design", "f", "--seed", "1", "--participants", "0", "-o", "x"],
            "a whole number from 1 to 100000, got '0'",
        ),
        (
            ["design", "f", "--seed", "1", "--probes", "a,,b", "-o", "x"],
            "names of letters, digits and hyphens",
        ),
        (
            ["analyse", "d", "a.csv", "-o", "x", "--ratings", "7-1"],
            "must be LOW-HIGH such as 1-7, got '7-1'",
        ),
        (
            ["power", "f", "--seed", "1", "--damping", "bare"],
            "must be name=share, separated by commas, got 'bare'",
        ),
        (["power", "f", "--seed", "1", "--participants", "4,x"], "got 'x'"),
        (
            ["power", "f", "--seed", "1", "--noise", "5"],
            "must be a length such as '25 um', got '5'",
        ),
        (["simulate", "d"], "Missing option '--seed'"),
    ],
)
def test_an_option_that_cannot_be_read_is_named(arguments, message, capsys):
    assert main(["study", *arguments]) == 2
    assert message in capsys.readouterr().err


def test_the_defaults_that_the_help_states_are_what_happens_without_options(tmp_path, capsys):
    # files that stand there are only accepted with the same content
    stated = [
        "--experiment",
        "estimates",
        "--participants",
        10,
        "--probes",
        "bare,hard,soft",
        "--repetitions",
        3,
    ]
    for options in ([], stated):
        assert run(capsys, "design", FOUR, *options, "--seed", 1, "-o", tmp_path)[0] == 0
    stated = [
        "--weber",
        0.2,
        "--noise",
        "5 um",
        "--spread",
        "3 um",
        "--condition-spread",
        "0 um",
        "--lapse",
        0,
    ]
    for options in ([], stated):
        assert (
            run(
                capsys,
                "simulate",
                tmp_path,
                FOUR,
                *options,
                "--seed",
                1,
                "-o",
                tmp_path / "answers.csv",
            )[0]
            == 0
        )


def test_a_scale_of_ratings_is_taken(tmp_path, capsys):
    answers, report = tmp_path / "answers.csv", tmp_path / "report"
    design = ["--experiment", "virtual", "--participants", 3, "--repetitions", 1]
    assert run(capsys, "design", FOUR, *design, "--seed", 1, "-o", tmp_path)[0] == 0
    assert run(capsys, "simulate", tmp_path, FOUR, "--seed", 2, "-o", answers)[0] == 0
    code, _, err = run(capsys, "analyse", tmp_path, answers, "--ratings", "1-2", "-o", report)
    assert (code, "realism_rating must be a whole number from 1 to 2" in err, report.exists()) == (
        2,
        True,
        False,
    )


def test_where_it_is_felt_can_be_chosen_and_is_checked(folder, capsys):
    simulate = ["simulate", folder, FOUR, "--seed", 2, "-o", folder / "answers.csv"]
    for options, message in (
        (["--tip-radius", "0 um"], "ball_radius must be positive and finite, got 0 m"),
        (["--load", "-1 N"], "normal_load must be positive and finite, got -1 N"),
        (["--friction", "0.9"], "must release the probe to be felt by its vibration"),
    ):
        code, _, err = run(capsys, *simulate, *options)
        assert (code, message in err) == (2, True)
    assert (
        run(capsys, *simulate, "--tip-radius", "0.2 mm", "--load", "1.5 N", "--friction", "10 %")[0]
        == 0
    )


def test_every_kind_of_experiment_can_be_asked_for(capsys):
    from stepblocks.study.experiments.registry import EXPERIMENTS

    assert main(["study", "design", "--help"]) == 0
    text = "".join(capsys.readouterr().out.split())
    assert all(name in text for name in (*EXPERIMENTS, "2afc"))
