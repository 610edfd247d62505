// Make the timeline of a participant: place the block, then answer.
// It needs jsPsych 7 or later with the plugins html-button-response and
// {{ "html-keyboard-response" if kind.paired else "survey-text" }}.
function makeStepblocksTimeline(jsPsych, participant) {
  if (!(participant in stepblocksTrials)) {
    throw new Error("participant must be one of " + Object.keys(stepblocksTrials).join(", "));
  }
  const data = {};
  for (const name of Object.keys(stepblocksTrials[participant][0])) {
    data[name] = jsPsych.timelineVariable(name);
  }
  const read = (name) => jsPsych.evaluateTimelineVariable(name);
  const place = {
    type: jsPsychHtmlButtonResponse,
{% if kind.paired %}
    stimulus: () => "First " + read("sb_first_code") + ", then " + read("sb_second_code"),
{% else %}
    stimulus: () => read("sb_condition") + ": block " + read("sb_code"),
{% endif %}
    choices: ["Continue"],
  };
  const answer = {
{% if kind.paired %}
    type: jsPsychHtmlKeyboardResponse,
    stimulus: "Is the second block higher? y: yes, n: no",
    choices: ["y", "n"],
    data: Object.assign({ sb_answer: "{{ kind.answers[0] }}" }, data),
{% else %}
    type: jsPsychSurveyText,
    questions: [
{% for answer in kind.answers %}
      { prompt: {{ prompts[answer] }}, name: "{{ answer }}", required: true },
{% endfor %}
    ],
    data: data,
{% endif %}
  };
  return { timeline: [place, answer], timeline_variables: stepblocksTrials[participant] };
}

if (typeof module !== "undefined") {
  module.exports = { stepblocksTrials, makeStepblocksTimeline };
}
