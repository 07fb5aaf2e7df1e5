"use strict";
// The view shared by the live page and the replay: Meshcat's viewer, its panel hidden, and a camera
// at the robot's front left. Points are in the robot's base frame, in metres.
const EYE = [3.05, 2.0, 0.95];
const TARGET = [0.36, 0.08, -0.1];
const FIELD_OF_VIEW_DEG = 36;
const ASPECT_IN_MIND = 1.5; // narrower windows step back until the same width is in view

// Meshcat's camera lives in three.js' axes: y up, z towards the viewer.
const toThree = ([x, y, z]) => [x, z, -y];

function createViewer() {
  const pane = document.getElementById("view");
  const viewer = new MeshCat.Viewer(pane);
  viewer.gui.domElement.style.display = "none";
  viewer.camera.fov = FIELD_OF_VIEW_DEG;
  const retreat = Math.max(1, ASPECT_IN_MIND / (window.innerWidth / window.innerHeight));
  const eye = EYE.map((value, i) => TARGET[i] + retreat * (value - TARGET[i]));
  viewer.camera.position.set(...toThree(eye));
  viewer.controls.target.set(...toThree(TARGET));
  viewer.controls.minDistance = 0.2;
  viewer.controls.maxDistance = 8;
  viewer.controls.update();
  viewer.set_3d_pane_size();
  return viewer;
}

function showCaption(text) {
  const caption = document.getElementById("caption");
  if (caption.textContent !== text) caption.textContent = text;
}
