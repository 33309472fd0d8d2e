"use strict";
// The curves of a comparison: one structure beside what was measured, and dashed the best of the other kind of orders.

const host = document.getElementById("curves"), recording = document.getElementById("recording");
const choices = [...document.querySelectorAll('input[name="structure"]')];

for (const [k, { name, heldOut }] of DATA.recordings.entries()) recording.add(new Option(heldOut ? `${name} (held out)` : name, k));

function show() {
  const chosen = choices.findIndex(choice => choice.checked), beside = DATA.best[DATA.fractional[chosen] ? 0 : 1];
  const { name, heldOut, t, outputs } = DATA.recordings[recording.value], x = line(floats(t));
  const kept = Chart.all.map(chart => chart.plot && chart.zoomed ? chart.plot.scales.x : null);
  Chart.all = [];
  host.replaceChildren();
  outputs.forEach((o, k) => {
    const lines = [["measured", o.measured, "measured"], [DATA.structures[chosen], o.simulated[chosen], "fitted"], [DATA.structures[beside], o.simulated[beside], "dashed"]];
    const series = lines.filter(([, y], i) => y && (i < 2 || beside !== chosen)).map(([label, y, kind]) => ({ label, y: line(floats(y)), kind, unit: o.unit }));
    const place = host.appendChild(document.createElement("div"));
    place.className = "chart";
    new Chart(place, {
      title: `${o.letter}, ${name}${heldOut ? ", held out" : ""}`, x, xname: "time", series, height: 210,
      ylabel: o.letter + (o.unit ? ` [${o.unit}]` : ""), xlabel: k === outputs.length - 1 ? "time [s]" : "",
      built: chart => { if (kept[k]) { const { min, max } = kept[k]; kept[k] = null; chart.zoom(min, max); } },
    });
  });
}

document.querySelector("#structures tbody").addEventListener("click", event => {
  const choice = event.target.closest("tr").querySelector("input");
  if (!choice.checked) { choice.checked = true; show(); }
});
for (const control of [...choices, recording]) control.addEventListener("change", show);
choices[DATA.best[DATA.claimed]].checked = true;
show();
addEventListener("resize", Chart.resize);
document.getElementById("theme").addEventListener("change", () => Chart.rebuild());
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => Chart.rebuild());
