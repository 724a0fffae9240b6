"use strict";
// Draws what /events says. Everything that came over the network is set as text, never as markup.
const $ = (id) => document.getElementById(id);
const CELL_M = 0.2;
const map = { cells: [], path: [], beat: null, follow: true, box: null };

function rows(list, pairs) {
  list.replaceChildren(...pairs.flatMap(([name, value, kind]) => {
    const term = document.createElement("dt"), said = document.createElement("dd");
    term.textContent = name;
    said.textContent = value;
    if (kind) said.className = kind;
    return [term, said];
  }));
}

function lines(list, texts) {
  list.replaceChildren(...texts.map(([text, kind]) => {
    const item = document.createElement("li");
    item.textContent = text;
    if (kind) item.className = kind;
    return item;
  }));
}

function tell(beat) {
  const status = beat.status, there = beat.there;
  const state = !there ? "gone" : status ? status.state || status.quality || "starting" : "connecting";
  $("rover").textContent = beat.rover;
  document.title = `${beat.rover}: ${state}`;
  $("state").textContent = there ? state : "gone: the rover does not answer";
  $("state").className = state;
  lines($("reasons"), there && status ? status.reasons.map((reason) => [reason]) : []);
  const pose = beat.pose;
  rows($("pose"), pose ? [
    ["x, y", `${pose.x_m.toFixed(2)} m, ${pose.y_m.toFixed(2)} m`],
    ["heading", `${(pose.heading_rad * 180 / Math.PI).toFixed(1)} deg`],
    ["uncertain by", `${pose.sigma_m.toFixed(2)} m`],
    ["speed", `${beat.speed_mps.toFixed(2)} m/s`],
    ["landmarks", String(status ? status.landmarks ?? "-" : "-")],
    ["rate", status ? `${status.rate_hz.toFixed(1)} Hz` : "-"],
  ] : [["", "none yet"]]);
  if (status) {
    rows($("sensors"), [
      ...Object.entries(status.sensors).map(([name, each]) =>
        [name, `${each.state}, ${each.rate_hz.toFixed(1)} Hz${each.reason ? ": " + each.reason : ""}`, each.state]),
      ...Object.entries(status.sinks).map(([name, each]) =>
        [name, `${each.dropped} dropped, ${each.depth} waiting${each.trouble ? ": " + each.trouble : ""}`,
          each.trouble ? "error" : ""]),
    ]);
  }
  lines($("events"), beat.events.map((event) => {
    const time = new Date(event.stamp_s * 1000).toLocaleTimeString();
    return [`${time} ${event.source}: ${event.reason}`, event.severity === "info" ? "" : event.severity];
  }));
}

function bounds() {
  const pose = map.beat.pose || { x_m: 0, y_m: 0 };
  if (map.follow) return [pose.x_m - 12, pose.y_m - 9, pose.x_m + 12, pose.y_m + 9];
  let [left, low, right, high] = [pose.x_m - 3, pose.y_m - 3, pose.x_m + 3, pose.y_m + 3];
  for (const [column, row] of map.cells) {
    left = Math.min(left, column * CELL_M); right = Math.max(right, column * CELL_M);
    low = Math.min(low, row * CELL_M); high = Math.max(high, row * CELL_M);
  }
  return [left - 1, low - 1, right + 1, high + 1];
}

function draw() {
  const canvas = $("map"), pen = canvas.getContext("2d"), look = getComputedStyle(document.body);
  const dot = window.devicePixelRatio || 1;  // one pixel of the page, so that lines are as wide on every screen
  canvas.width = Math.round(canvas.clientWidth * dot);
  canvas.height = Math.round(canvas.width * 3 / 4);
  const [left, low, right, high] = bounds();
  const scale = Math.min(canvas.width / (right - left), canvas.height / (high - low));
  const x = (at) => canvas.width / 2 + (at - (left + right) / 2) * scale;
  const y = (at) => canvas.height / 2 - (at - (low + high) / 2) * scale;
  const colour = (of) => look.getPropertyValue(`--${of}`);
  pen.fillStyle = look.backgroundColor;
  pen.fillRect(0, 0, canvas.width, canvas.height);
  pen.fillStyle = colour("cell");
  const side = Math.max(dot, Math.ceil(CELL_M * scale));
  for (const [column, row] of map.cells)
    pen.fillRect(Math.floor(x(column * CELL_M)), Math.floor(y((row + 1) * CELL_M)), side, side);
  pen.strokeStyle = colour("path");
  pen.lineWidth = 2 * dot;
  pen.lineJoin = "round";
  pen.beginPath();
  map.path.forEach(([east, north], k) => (k ? pen.lineTo(x(east), y(north)) : pen.moveTo(x(east), y(north))));
  pen.stroke();
  pen.fillStyle = colour("beam");
  const scan = map.beat.scan;
  for (let k = 0; k < scan.length; k += 2) pen.fillRect(x(scan[k]) - 1.25 * dot, y(scan[k + 1]) - 1.25 * dot, 2.5 * dot, 2.5 * dot);
  pen.fillStyle = colour("landmark");
  const landmarks = map.beat.landmarks;
  for (let k = 0; k < landmarks.length; k += 2) {
    pen.beginPath();
    pen.arc(x(landmarks[k]), y(landmarks[k + 1]), 3 * dot, 0, 2 * Math.PI);
    pen.fill();
  }
  const pose = map.beat.pose;
  if (pose) {
    pen.fillStyle = look.color;
    pen.beginPath();
    for (const [steps, turn] of [[14, 0], [10, 2.5], [10, -2.5]]) {
      const ahead = steps * dot;
      pen.lineTo(x(pose.x_m) + ahead * Math.cos(pose.heading_rad + turn), y(pose.y_m) - ahead * Math.sin(pose.heading_rad + turn));
    }
    pen.fill();
  }
  const metre = 10 ** Math.floor(Math.log10((right - left) / 4));
  pen.fillStyle = look.color;
  pen.fillRect(12 * dot, canvas.height - 14 * dot, metre * scale, 3 * dot);
  pen.font = `${14 * dot}px system-ui, sans-serif`;
  pen.fillText(`${metre} m`, 12 * dot, canvas.height - 20 * dot);
}

function listen() {
  const source = new EventSource("events");
  source.addEventListener("anew", () => { map.cells = []; map.path = []; });
  source.addEventListener("grown", (event) => {
    const grown = JSON.parse(event.data);
    map.cells.push(...grown.cells);
    map.path.push(...grown.path);
  });
  source.addEventListener("beat", (event) => {
    const beat = JSON.parse(event.data);
    if (!beat) return;
    map.beat = beat;
    tell(beat);
    requestAnimationFrame(draw);
  });
  source.onerror = () => {
    $("state").textContent = "no connection to the page's server";
    $("state").className = "gone";
    if (source.readyState === EventSource.CLOSED) setTimeout(listen, 2000);
  };
}

async function runs() {
  const answer = await fetch("runs");
  if (!answer.ok) return;
  const found = await answer.json();
  const told = found.runs.map((run) => [run.name, `${run.verdict} (${run.is_all ? "" : "over "}${run.mb} MB)`]);
  rows($("runs"), [["disk", found.free_gb === null ? "no such folder" : `${found.free_gb} GB free`], ...told]);
}

async function command(name) {
  const headers = { "content-type": "application/json", "x-infant": "1" };
  const body = JSON.stringify({ command: name, reason: $("reason").value });
  const answer = await fetch("command", { method: "POST", headers, body });
  const said = answer.headers.get("content-type").includes("json") ? await answer.json() : { reason: await answer.text() };
  $("answer").textContent = said.accepted ? `${name}: accepted` : `${name}: refused: ${said.reason}`;
}

function look_at(follow) {
  map.follow = follow;
  $("follow").setAttribute("aria-pressed", follow);
  $("all").setAttribute("aria-pressed", !follow);
  if (map.beat) draw();
}

$("follow").onclick = () => look_at(true);
$("all").onclick = () => look_at(false);
$("mark").onclick = () => command("mark");
$("stop").onclick = () => confirm("Stop the recording? Only a new run records again.") && command("stop");
fetch("allowed").then((answer) => answer.json()).then((said) => { $("commands").hidden = !said.commands; });
listen();
runs();
setInterval(runs, 30000);
