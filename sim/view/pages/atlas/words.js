// The texts about the chosen cell.
const OF = { left: "the left arm", right: "the right arm", either: "both arms", both: "one arm at least" };
const number = (value, digits) => value.toFixed(digits).replace(/^-(?=0\.?0*$)/, "").replace("-", "−");
const degrees = (angle) => `${number((angle * 180) / Math.PI, 0)}°`;
const metres = (value) => `${number(value, atlas.map.step < 0.0999 ? 3 : 2)} m`;
const nameOf = (rotation) => `tool ${atlas.map.directions[Math.floor(rotation / rollCount())]}, roll ${degrees(atlas.map.rolls[rotation % rollCount()])}`;

// The verdict on a pose, or on all chosen rotations at a position where none is reached.
function verdict(arm, rotation, counts) {
  if (rotation === null) {
    const parts = [[counts.unreachable, "proven out of reach"], [counts.undecided, "undecided"], [counts.total - counts.unreachable - counts.undecided, "not computed"]];
    const described = parts.filter(([count]) => count).map(([count, words]) => (count === counts.total ? `all ${count} ${words}` : `${count} ${words}`));
    return `No rotation is reached: ${described.join(", ")}`;
  }
  const level = levelAt(arm, rotation, placeOf(choice.cell));
  if (level === UNREACHABLE) return `Proven out of reach of ${OF[arm]}`;
  return level === UNDECIDED ? "Undecided: neither a witness nor a proof" : "Not computed";
}

// How many of the chosen rotations one arm reaches here.
function showShares(rotations, place) {
  for (const side of ["left", "right"]) {
    const arm = atlas.map.arms.indexOf(side);
    const reached = arm < 0 ? 0 : rotations.filter((r) => levelOf(arm, r, place) >= FIRST_LEVEL).length;
    const one = arm >= 0 && rotations.length === 1 ? levelOf(arm, rotations[0], place) : null;
    const text = one === null ? `${reached} of ${rotations.length} rotations` : one >= FIRST_LEVEL ? `margin ${number(marginOf(one), 2)} rad` : STATUS[one];
    write(element(`${side}-share`), arm < 0 ? "" : `${side}: ${text}`);
  }
}

function showWords({ rotation, counts, witness }) {
  const [x, y, z] = pointOf(choice.cell);
  const isShown = witness !== null && witness.isMet;
  const reached = choice.arm === "both" ? `Reached by both arms; shown: the ${(witness || {}).side}` : `Reached by the ${(witness || {}).side} arm`;
  write(element("caption"), isShown ? reached : witness ? "This witness cannot be shown" : verdict(choice.arm, rotation, counts));
  element("caption").classList.toggle("long", element("caption").textContent.length > 34);
  write(element("pose"), `x ${metres(x)}, y ${metres(y)}, z ${metres(z)}${rotation === null ? "" : `; ${nameOf(rotation)}`}`);
  const margin = isShown ? Math.min(...witness.margins) : 0;
  write(element("margin"), isShown ? `margin ${number(margin, 3)} rad (${degrees(margin)})` : "");
  write(element("status"), witness && !isShown ? "Forward kinematics does not find it at its pose inside the limits, so the arm stays." : "");
  showWitness(witness, isShown);
  announce(`${element("caption").textContent}. ${element("pose").textContent}. ${element("margin").textContent}`);
}

const micro = (value) => (value < 1e-9 ? "under 0.001" : number(value * 1e6, 3));

function showWitness(witness, isShown) {
  const arm = isShown ? atlas.arms[witness.side] : null;
  const allowed = number(atlas.polishing.tolerance * 1e6, 0);
  write(element("check"), isShown ? `Checked here by forward kinematics: off by ${micro(witness.offset)} µm and ${micro(witness.angle)} µrad, of ${allowed} each that are allowed; inside all joint limits.` : "None: this cell has no configuration to show. The arms are in their neutral pose.");
  element("joint-table").hidden = !isShown;
  element("joints").replaceChildren(...(isShown ? witness.q.map((angle, joint) => make("tr", {}, make("th", { scope: "row", textContent: arm.joints[joint] }), make("td", { textContent: number(angle, 4) }), marginCell(witness.margins[joint], arm, joint))) : []));
}

function marginCell(margin, arm, joint) {
  const most = (arm.high[joint] - arm.low[joint]) / 2;
  const meter = make("meter", { min: 0, max: most, value: margin, title: `of ${number(most, 2)} rad in the middle of its range` });
  meter.setAttribute("aria-hidden", "true");
  return make("td", {}, meter, ` ${number(margin, 3)}`);
}
