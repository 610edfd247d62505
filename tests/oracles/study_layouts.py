"""Judgements as other programs write them: the files of PsychoPy, jsPsych and their like.

Each writer takes rows of texts by column: participant, what the study varies, and the answers.
"""

import csv
import io
import json
from pathlib import Path


def write_csv(rows, names, quoting=csv.QUOTE_MINIMAL, end="\n"):
    text = io.StringIO()
    writer = csv.DictWriter(text, names, restval="", quoting=quoting, lineterminator=end)
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def split_by_participant(rows, column="participant"):
    people = {}
    for row in rows:
        people.setdefault(row[column], []).append(row)
    return people


def split_row(row, answers):
    varied = {name: text for name, text in row.items() if name not in (*answers, "participant")}
    return varied, {answer: row[answer] for answer in answers}


def write_psychopy(folder, rows, answers, component="slider.response"):
    """A file for each participant: byte order mark, instructions, None, and a trailing comma."""
    for person, own in split_by_participant(rows).items():
        info = {
            "participant": person,
            "session": "001",
            "date": "2026-11-29_10h27.31.123",
            "expName": "steps",
            "psychopyVersion": "2024.2.4",
            "frameRate": "59.951",
            "expStart": "2026-11-29 10h27.35.880 +0100",
        }
        entries = [{"instructions.keys": "space", "instructions.rt": "3.2", **info}]
        for number, row in enumerate(own):
            varied, given = split_row(row, answers)
            entry = {
                **varied,
                "trials.thisRepN": 0,
                "trials.thisTrialN": number,
                "trials.thisN": number,
                "trials.thisIndex": number,
                "thisRow.t": f"{10.0 + number:.6f}",
                "trial.started": f"{10.1 + number:.6f}",
                **info,
            }
            for answer, text in given.items():
                name = component or f"{answer}.text"
                entry[name] = text or "None"
                entry[name.rpartition(".")[0] + ".rt"] = "1.25" if text else "None"
            entries.append(entry)
        entries.append({"thanks.started": "99.1", **info})
        names = [*dict.fromkeys(name for entry in entries for name in entry), ""]
        text = write_csv(entries, names)
        Path(folder, f"{person}_steps.csv").write_bytes(b"\xef\xbb\xbf" + text.encode())


def list_jspsych(rows, answers, kind, person):
    trials = [
        {
            "success": True,
            "timeout": False,
            "trial_type": "preload",
            "time_elapsed": 35,
            "rt": None,
        }
    ]
    for row in rows:
        varied, given = split_row(row, answers)
        trials.append(
            {
                "rt": None,
                "stimulus": "<p>+</p>",
                "response": None,
                "trial_type": "html-keyboard-response",
                **varied,
            }
        )
        response = given[answers[0]] or None
        if kind == "survey-text":
            response = given
        elif kind == "html-slider-response" and response:
            response = float(response)
        trials.append(
            {
                "rt": 1830,
                "stimulus": "<p>How high?</p>",
                "response": response,
                "trial_type": kind,
                **varied,
            }
        )
    for number, trial in enumerate(trials):
        trial["trial_index"] = number
        trial.setdefault("time_elapsed", 1000 * number)
        trial["plugin_version"] = "2.1.0"
        trial["participant"] = person
    return trials


def write_jspsych(folder, rows, answers, kind="html-slider-response", form="csv"):
    """A file for each participant, as `jsPsych.data.get().csv()` or `.json()` writes it."""
    for person, own in split_by_participant(rows).items():
        trials = list_jspsych(own, answers, kind, person)
        path = Path(folder, f"participant-{person}.{form}")
        if form == "json":
            path.write_text(json.dumps(trials), encoding="utf-8")
            continue
        names = list(dict.fromkeys(name for trial in trials for name in trial))
        cells = []
        for trial in trials:
            cells.append({name: write_js(trial.get(name, "")) for name in names})
        path.write_bytes(write_csv(cells, names, csv.QUOTE_ALL, "\r\n").encode())


def write_js(value):
    """Write a value as `JSON2CSV` of jsPsych does: null and true as words, objects as JSON."""
    if isinstance(value, str):
        return value
    return json.dumps(value, separators=(",", ":"))


def write_opensesame(folder, rows, answers, variables=300):
    """A file for each participant with every variable of the experiment, sorted, all quoted."""
    for number, (person, own) in enumerate(split_by_participant(rows).items(), 1):
        entries = []
        for trial, row in enumerate(own):
            varied, given = split_row(row, answers)
            answer = given[answers[0]] or "None"
            entry = {
                **varied,
                "subject_nr": person,
                "subject_parity": "odd" if number % 2 else "even",
                "opensesame_version": "4.0.24",
                "opensesame_codename": "Melodramatic Milgram",
                "count_trial_sequence": trial,
                "count_keyboard_response": trial,
                "time_fixation": 1000 + trial,
                "height": 768,
                "width": 1024,
                "title": "Steps",
                "response": answer,
                "response_time": "1250.5",
                "response_keyboard_response": answer,
                "response_time_keyboard_response": "1250.5",
                "correct": "undefined",
                "average_response_time": "NA",
                "live_row": trial,
            }
            entry |= {f"time_item_{item}": "NA" for item in range(variables)}
            entries.append(entry)
        names = sorted(entries[0])
        Path(folder, f"subject-{person}.csv").write_text(
            write_csv(entries, names, csv.QUOTE_ALL), encoding="utf-8"
        )


def write_qualtrics(path, rows, answer):
    """One row for each participant under three rows of headers, a preview among them."""
    people = split_by_participant(rows)
    fixed = {
        "StartDate": "Start Date",
        "EndDate": "End Date",
        "Status": "Response Type",
        "IPAddress": "IP Address",
        "Progress": "Progress",
        "Duration (in seconds)": "Duration (in seconds)",
        "Finished": "Finished",
        "RecordedDate": "Recorded Date",
        "ResponseId": "Response ID",
        "DistributionChannel": "Distribution Channel",
        "UserLanguage": "User Language",
    }
    responses = []
    for person, own in people.items():
        response = {
            "StartDate": "2026-11-29 10:01:02",
            "EndDate": "2026-11-29 10:31:02",
            "Status": "IP Address",
            "IPAddress": "192.0.2.7",
            "Progress": "100",
            "Duration (in seconds)": "1800",
            "Finished": "True",
            "RecordedDate": "2026-11-29 10:31:03",
            "ResponseId": f"R_{person}",
            "DistributionChannel": "anonymous",
            "UserLanguage": "EN",
        }
        met = {}
        for row in own:
            cell = f"{row['condition']}_{row['height_um']}"
            met[cell] = met.get(cell, 0) + 1
            response[f"{cell}_{met[cell]}"] = row[answer]
        responses.append(response)
    questions = [name for name in responses[0] if name not in fixed]
    names = [*fixed, *questions]
    preview = {**responses[0], "Status": "Survey Preview", "ResponseId": "R_preview"}
    headers = [
        {**fixed, **dict.fromkeys(questions, "How high is the block,\nin micrometres?")},
        {name: json.dumps({"ImportId": f"QID_{name}"}) for name in names},
    ]
    Path(path).write_text(write_csv([*headers, preview, *responses], names), encoding="utf-8")


def write_gorilla(path, rows, answers):
    """All participants in one file: a row for every event, the task's spreadsheet at the end."""
    entries = []
    trials = {}
    for row in rows:
        varied, given = split_row(row, answers)
        person = row["participant"]
        trials[person] = trials.get(person, 0) + 1
        shared = {
            "UTC Timestamp": "1795946400000",
            "Experiment ID": "11596",
            "Participant Public ID": f"public-{person}",
            "Participant Private ID": person,
            "Participant Status": "complete",
            "Task Name": "steps",
            "Spreadsheet Row": trials[person],
            "Trial Number": trials[person],
            "Screen Number": "1",
            "Attempt": "1",
            "display": "task",
            **varied,
        }
        entries.append({**shared, "Zone Type": "fixation", "Reaction Time": "500.1"})
        entries.append(
            {
                **shared,
                "Zone Name": "Zone2",
                "Zone Type": "response_slider_endValue",
                "Reaction Time": "1830.2",
                "Response": given[answers[0]],
            }
        )
        entries.append({**shared, "Zone Type": "continue_button", "Response": "Next"})
    for number, entry in enumerate(entries):
        entry["Event Index"] = number + 1
    names = ["Event Index", "Zone Name", *entries[0]]
    names = list(dict.fromkeys([*names, "Response"]))
    text = write_csv(entries, names)
    Path(path).write_text(f"{text}END OF FILE{',' * (len(names) - 1)}\n", encoding="utf-8")
