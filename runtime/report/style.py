"""The page's style sheet: readable on a phone, on paper, in light and in dark."""

STYLE = """
:root{--paper:#fff;--ink:#1c2126;--quiet:#5d6873;--line:#d9dee3;--card:#f5f7f9;--a:#0b64c0;--b:#c2570c;--c:#2d7d3a;
--info:#4a6785;--warn:#9a6200;--error:#b3261e;--mark:#f3d9a4;color-scheme:light dark}
@media(prefers-color-scheme:dark){:root{--paper:#14181c;--ink:#e6eaee;--quiet:#9aa6b2;--line:#343c44;--card:#1d2329;
--a:#6cb0ff;--b:#ff9d57;--c:#74cf83;--info:#93b4d6;--warn:#f0b64a;--error:#ff8a80;--mark:#574320}}
*{box-sizing:border-box}
body{margin:0 auto;padding:1rem;max-width:76rem;background:var(--paper);color:var(--ink);
font:16px/1.45 system-ui,"Segoe UI",Roboto,"DejaVu Sans",sans-serif;overflow-wrap:anywhere}
h1{font-size:1.4rem;margin:.2rem 0}h2{font-size:1.12rem;margin:1.7rem 0 .5rem;border-bottom:1px solid var(--line)}
h3{font-size:.95rem;margin:.9rem 0 .2rem;font-weight:600}
p{margin:.3rem 0}.quiet{color:var(--quiet);font-size:.9rem}
.verdict{padding:.6rem .9rem;border-left:.4rem solid var(--c);background:var(--card);font-size:1.1rem}
.verdict.warn{border-color:var(--warn)}.verdict.error{border-color:var(--error)}
.tiles{display:grid;grid-template-columns:repeat(auto-fit,minmax(8.5rem,1fr));gap:.6rem;margin:.8rem 0}
.tile{background:var(--card);padding:.5rem .7rem}.tile b{
display:block;font-size:1.15rem;font-variant-numeric:tabular-nums}
.tile span{color:var(--quiet);font-size:.82rem}
.finding{border-left:.3rem solid var(--info);background:var(--card);padding:.5rem .8rem;margin:.6rem 0;
break-inside:avoid}
.finding.warn{border-color:var(--warn)}.finding.error{border-color:var(--error)}
.finding h3{margin:0}.finding .mark{text-transform:uppercase;font-size:.72rem;letter-spacing:.05em;color:var(--info)}
.finding.warn .mark{color:var(--warn)}.finding.error .mark{color:var(--error)}
.finding dl{display:grid;grid-template-columns:5.2rem 1fr;gap:.1rem .6rem;margin:.3rem 0 0;font-size:.92rem}
dt{color:var(--quiet)}dd{margin:0}code{font-family:ui-monospace,"DejaVu Sans Mono",monospace;font-size:.88em}
.pair{display:grid;grid-template-columns:repeat(auto-fill,minmax(min(100%,26rem),1fr));gap:.4rem 1.6rem}
.pair>div{min-width:0;break-inside:avoid}
svg{width:100%;height:auto;display:block}svg text{fill:var(--quiet);font-size:13px}
.grid{stroke:var(--line);stroke-width:1;fill:none}.curve{fill:none;stroke-width:1.8;stroke-linejoin:round}
.when{max-width:46rem}
.bar.info{fill:var(--info)}.bar.warn{fill:var(--warn)}.bar.error{fill:var(--error)}svg text.name{fill:var(--ink)}
.marked{fill:var(--mark);opacity:.75}
.curve.a,.curve.path-a{stroke:var(--a)}.curve.b,.curve.path-b{stroke:var(--b);stroke-dasharray:5 3}
.curve.c,.curve.path-c{stroke:var(--c);stroke-dasharray:2 3;stroke-width:2.2}
.dots.a{fill:var(--a)}.dots.c{fill:var(--c)}.dots.q{fill:var(--quiet);opacity:.65}
.legend{list-style:none;display:flex;flex-wrap:wrap;gap:.1rem 1.1rem;margin:.1rem 0;padding:0;font-size:.85rem}
.legend li::before{content:"";display:inline-block;width:1.1em;border-top:3px solid var(--quiet);margin-right:.4em;
vertical-align:middle}
.legend .dot::before{width:.45em;height:.45em;border:0;border-radius:50%;background:var(--quiet)}
.legend .a::before,.legend .path-a::before{border-color:var(--a)}
.legend .b::before,.legend .path-b::before{border-color:var(--b);border-top-style:dashed}
.legend .c::before,.legend .path-c::before{border-color:var(--c);border-top-style:dotted}
table{border-collapse:collapse;width:100%;font-size:.9rem;font-variant-numeric:tabular-nums}
th,td{text-align:left;padding:.2rem .6rem .2rem 0;border-bottom:1px solid var(--line);vertical-align:top}
td,th{overflow-wrap:normal}td:last-child{overflow-wrap:anywhere}
.events td:not(:last-child){white-space:nowrap}
.events td:last-child{min-width:16rem}
th{color:var(--quiet);font-weight:500}.scroll{overflow-x:auto}details{margin:.6rem 0}summary{cursor:pointer}
@media(max-width:34rem){svg text{font-size:17px}
.events tr{display:grid;grid-template-columns:auto auto 1fr;gap:0 .8rem;border-bottom:1px solid var(--line)}
.events td,.events th{border:0}.events td:last-child{grid-column:1/-1;min-width:0}.events tr:first-child{display:none}
.finding dl{grid-template-columns:1fr}dd{margin-bottom:.2rem}}
@media print{:root{--paper:#fff;--ink:#000;--quiet:#444;--line:#bbb;--card:#fff;--a:#0b64c0;--b:#c2570c;--c:#2d7d3a;
--info:#4a6785;--warn:#9a6200;--error:#b3261e;--mark:#f3d9a4}
body{font-size:10pt;max-width:none}h2{break-after:avoid}details{display:none}.pair svg text{font-size:17px}
.pair{grid-template-columns:1fr 1fr}section>h2+*{break-before:avoid}.tiles{grid-template-columns:repeat(4,1fr)}}
"""
