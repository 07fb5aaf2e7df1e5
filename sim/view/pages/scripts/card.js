// The card that describes what is going on.
const MIN_LONG_CAPTION = 60; // characters; a reason for a failure is written smaller

function showCaption(text) {
  write(element("caption"), text);
  element("caption").classList.toggle("long", text.length > MIN_LONG_CAPTION);
}

function showSeed(seed) {
  write(element("seed"), seed && `IK seed: ${seed}`);
}

// By side, what a gripper does: words and mood.
function showGrippers(grippers) {
  for (const [side, [words, mood]] of Object.entries(grippers)) {
    const chip = element(`${side}-gripper`);
    write(chip, `${side} gripper: ${words}`);
    chip.dataset.mood = mood;
  }
}

function showStatus(text) {
  write(element("status"), text);
}
