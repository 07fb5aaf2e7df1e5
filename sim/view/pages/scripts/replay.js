startWith(() => {
  startPage();
  startReplay(decode(element("data").textContent));
  if (!prefersStill.matches) replay.play();
});
