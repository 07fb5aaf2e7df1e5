"use strict";
// What the live page and the replay share: Meshcat's viewer with its panel hidden, the first view,
// and the card that says what is going on. Points are in the robot's base frame, in metres.
const EYE = [2.85, 1.75, 1.1];
const TARGET = [0.42, 0.04, 0.01];
const FIELD_OF_VIEW_DEG = 36;
const ASPECT_IN_MIND = 1.3; // narrower windows step back until the same width is in view

const LONG_CAPTION = 60; // characters; a reason for a failure is written smaller

const element = (id) => document.getElementById(id);

// Meshcat's camera lives in three.js' axes: y up, z towards the viewer.
const toThree = ([x, y, z]) => [x, z, -y];

// From the left front, or from the right one, if only the right arm moves.
function createViewer(sides = []) {
  const viewer = new MeshCat.Viewer(element("view"));
  viewer.gui.domElement.style.display = "none";
  viewer.camera.fov = FIELD_OF_VIEW_DEG;
  const mirror = sides.join() === "right" ? [1, -1, 1] : [1, 1, 1];
  const retreat = Math.max(1, ASPECT_IN_MIND / (window.innerWidth / window.innerHeight));
  const target = TARGET.map((value, i) => mirror[i] * value);
  const eye = EYE.map((value, i) => target[i] + retreat * (mirror[i] * value - target[i]));
  viewer.camera.position.set(...toThree(eye));
  viewer.controls.target.set(...toThree(target));
  viewer.controls.minDistance = 0.2;
  viewer.controls.maxDistance = 8;
  viewer.controls.update();
  viewer.set_3d_pane_size();
  return viewer;
}

// Start once "Loading" can be read, and say so when the browser cannot draw.
function startWith(start) {
  const attempt = () => {
    if (!canDraw()) return showProblem("This page draws in 3D with WebGL, which is switched off or missing in this browser. Try another browser, or turn on its hardware acceleration.");
    try { start(); } catch (error) { showProblem(`This page cannot be shown: ${error.message}`); throw error; }
  };
  requestAnimationFrame(() => setTimeout(attempt));
}

function canDraw() {
  const canvas = document.createElement("canvas");
  return Boolean(canvas.getContext("webgl2") || canvas.getContext("webgl"));
}

function showProblem(text) {
  element("problem").textContent = text;
  document.body.classList.add("failed");
}

function showCaption(text) {
  write(element("caption"), text);
  element("caption").classList.toggle("long", text.length > LONG_CAPTION);
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

function write(node, text) {
  if (node.textContent !== text) node.textContent = text;
}
