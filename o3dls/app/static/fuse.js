// A run: begun here, followed as the server tells it, whoever began it.

const shownRun = { source: null, state: "" };

async function begin() {
  if (proposal.T !== app.T && !shownRun.warned) { // a second press goes on
    shownRun.warned = true;
    say(byId("fused"), "The pose in the picture is not kept, and the run would not begin with it: press Keep this pose, or Run once more.", true);
    return;
  }
  const preset = document.querySelector("[name=preset]:checked").value;
  const answer = await ask("fuse", { case: app.case, preset });
  if (answer.error) say(byId("fused"), answer.error, true);
}

async function cancelRun() {
  const answer = await ask("cancel", {});
  if (answer.error) say(byId("fused"), answer.error, true);
}

function takeJob(job) {
  if (job.case !== app.case) return;
  const running = job.state === "running";
  const bar = byId("progress");
  byId("fuse").disabled = running;
  byId("cancel").hidden = bar.hidden = !running;
  bar.max = Math.max(job.steps, 1);
  if (running && !job.steps) bar.removeAttribute("value");
  else bar.value = job.done;
  byId("log").hidden = false;
  byId("log").textContent = [`$ ${job.command}`, ...job.lines].join("\n");
  byId("log").scrollTop = byId("log").scrollHeight;
  const now = running ? `${job.run}: ${job.done} of ${job.steps || "…"} steps, ${job.seconds} s.` : job.said;
  say(byId("fused"), now, job.state === "refused");
  if (job.state === "done") byId("fused").append(" ", made("a", "Judge it", { href: `run?folder=${encodeURIComponent(job.run)}` }));
}

// Only pages that are seen listen: a browser opens six connections to one server.
function listen() {
  if (document.hidden) {
    shownRun.source?.close();
    shownRun.source = null;
  } else if (!shownRun.source) {
    shownRun.source = new EventSource("events");
    shownRun.source.addEventListener("job", ({ data }) => takeJob(JSON.parse(data)));
  }
}

byId("fuse").addEventListener("click", begin);
byId("cancel").addEventListener("click", cancelRun);
document.addEventListener("visibilitychange", listen);
listen();
