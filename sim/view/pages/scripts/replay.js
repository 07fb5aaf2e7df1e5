startWith(async () => {
  startPage();
  startReplay(await decode(element("data").textContent));
  if (!prefersStill.matches) replay.play();
});
