// What the app asks of the report's viewer: which place or point is pinned. Runs in the viewer's scope.

const told = { pick: () => {} };
host.addEventListener("pin", () => {
  if (pinned) told.pick({ kind: pinned.point === undefined ? "prior" : "map", at: pinned.at.toArray() });
});

// The place of the prior, or the point, in the middle of the picture: for those who turn it by keys.
function pinMiddle() {
  const [panel] = panels;
  const box = panel.canvas.getBoundingClientRect();
  pin(hit(panel, { clientX: box.left + box.width / 2, clientY: box.top + box.height / 2 }));
  return Boolean(pinned);
}

const app = { pinMiddle, onPick: (pick) => { told.pick = pick; } };
