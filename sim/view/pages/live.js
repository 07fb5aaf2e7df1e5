// Shows what the program sends. Binary messages are Meshcat's commands; text is for the page itself:
// a topic and its value.
const SHOW = { caption: showCaption, seed: showSeed, grippers: showGrippers };
const RETRY_MS = 1500;
const url = `${location.protocol.replace("http", "ws")}//${location.host}/scene`;
let viewer;

// A program started again on this port finds the page still open.
function retry() {
  const probe = new WebSocket(url);
  probe.onopen = () => location.reload();
  probe.onerror = () => setTimeout(retry, RETRY_MS);
}

startWith(() => {
  viewer = createViewer();
  viewer.connect(url);
  const drawCommand = viewer.connection.onmessage;
  viewer.connection.onmessage = (message) => {
    if (typeof message.data !== "string") return drawCommand(message);
    const [topic, value] = JSON.parse(message.data);
    return SHOW[topic](value);
  };
  viewer.connection.onopen = () => { element("status").textContent = ""; };
  viewer.connection.onclose = () => {
    element("status").textContent = "The program has ended. This page wakes up when it runs again.";
    setTimeout(retry, RETRY_MS);
  };
});
