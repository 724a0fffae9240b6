(() => {
const model = name => Bokeh.documents.map(d => d.get_model_by_name(name)).find(m => m)
window.rover_at = time => {
  const path = model("path"), here = model("here")
  if (!path || !here || !path.data.t) return
  const t = path.data.t
  let low = 0, high = t.length - 1
  while (low < high) { const middle = (low + high) >> 1; if (t[middle] < time) low = middle + 1; else high = middle }
  here.data = {x: [path.data.x[low]], y: [path.data.y[low]]}
}
const show = (start, end) => {
  const range = model("time"), picked = model("picked"), path = model("path"), way = model("picked path")
  const margin = Math.max(2, 0.5 * (end - start))
  if (range) range.setv({start: Math.max(0, start - margin), end: end + margin})
  if (picked) picked.setv({left: start, right: Math.max(end, start + 0.1), visible: true})
  if (!path || !way) return
  const inside = [...path.data.t.keys()].filter(i => path.data.t[i] >= start - 0.2 && path.data.t[i] <= end + 0.2)
  way.data = {x: inside.map(i => path.data.x[i]), y: inside.map(i => path.data.y[i])}
  window.rover_at(start)
}
const layers = node => [...(node.shadowRoot ? layers(node.shadowRoot) : []), ...[...node.children].flatMap(child =>
  child.tagName == "CANVAS" ? [child] : layers(child))]
addEventListener("beforeprint", () => document.querySelectorAll("[data-root-id]").forEach(drawing => {
  const drawn = layers(drawing)
  if (!drawn.length) return
  const copy = document.createElement("canvas")  // paper is narrower than the window, and no plot is drawn anew for it
  Object.assign(copy, {className: "printed", width: drawn[0].width, height: drawn[0].height})
  copy.style.width = drawn[0].clientWidth + "px"
  drawn.forEach(layer => layer.width && copy.getContext("2d").drawImage(layer, 0, 0))
  drawing.before(copy)
}))
addEventListener("afterprint", () => document.querySelectorAll(".printed").forEach(copy => copy.remove()))
document.querySelectorAll("button[data-start]").forEach(button => button.addEventListener("click", () => {
  show(+button.dataset.start, +button.dataset.end)
  document.getElementById("where").scrollIntoView({behavior: "smooth"})
}))
})()
