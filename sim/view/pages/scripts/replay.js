startWith(async () => {
  startPage();
  startReplay(unpack(await decode(element("data").textContent)));
  if (!prefersStill.matches) replay.play();
});
