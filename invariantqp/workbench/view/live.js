// While it runs: what there is of it so far, at its end the whole, which plays.
async function follow() {
  for (let tag = ""; ; await new Promise(wait => setTimeout(wait, 200))) {
    const answer = await fetch(`run?${tag}`).catch(() => null);
    if (!answer) { for (const control of ["play", "time", "speed"]) $(control).disabled = false; return; }
    if (answer.status !== 200) continue;
    tag = answer.headers.get("ETag");
    load(await answer.json());
    if (!run.live) { state.t = 0; play(true); return; }
    seek(time[frames - 1]);
  }
}
