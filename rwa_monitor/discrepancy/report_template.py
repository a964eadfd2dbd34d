"""The page of the discrepancy report (Jinja); see report.py for what goes in."""

from typing import Final

PAGE: Final = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>What the simulation of {{ wheel.name }} gets wrong</title>
<style>
:root { color-scheme: light; }
body { font: 16px/1.5 system-ui, sans-serif; color: #1c1c1c; background: #fff; margin: 0 auto; max-width: 1120px;
  padding: 1.5rem; }
h1 { font-size: 1.5rem; margin: 0 0 .3rem; } h2 { font-size: 1.15rem; margin: 2rem 0 .5rem; }
.verdict { border-left: .5rem solid #888; background: #f5f5f3; padding: .8rem 1rem; font-size: 1.15rem; }
.verdict.inadequate { border-color: #c1440e; } .verdict.adequate { border-color: #2b7a3d; }
table { border-collapse: collapse; margin: .5rem 0; } th, td { padding: .25rem .8rem; text-align: left;
  border-bottom: 1px solid #ddd; vertical-align: top; } td.n, th.n { text-align: right;
  font-variant-numeric: tabular-nums; }
.views { display: grid; grid-template-columns: repeat(auto-fill, minmax(330px, 1fr)); gap: 1rem; }
.views figure { margin: 0; } figcaption { font-size: .85rem; color: #444; }
svg { max-width: 100%; height: auto; }
pre { background: #f5f5f3; padding: .8rem; overflow-x: auto; font-size: .85rem; }
.small { color: #555; font-size: .9rem; } .sure { color: #c1440e; font-weight: 600; }
@media print { h2 { break-after: avoid; } figure { break-inside: avoid; } }
</style>
</head>
<body>
<h1>What the simulation of wheel “{{ wheel.name }}” gets wrong</h1>
<p class="small">{{ sources | join(", ") }} · {{ samples }} samples in motion{% if rest_slots %}, {{ rest_slots }} at
rest left out{% endif %}{% if clipped %}, {{ clipped }} outliers pulled in{% endif %} · noise
{{ noise_std_Nm | torque }} · {{ software }}</p>
<p class="verdict {{ result.verdict }}"><strong>{{ result.verdict | capitalize }}.</strong> {{ sentence }}</p>

<h2>Measured and simulated</h2>
{{ overlay | safe }}

{% if result.effects %}
<h2>What is missing</h2>
<table>
<tr><th>effect</th><th>parameters</th><th class="n">gain</th><th class="n">p</th><th>cannot be told from</th>
<th>what would tell</th></tr>
{% for effect in result.effects %}
<tr><td><strong>{{ effect.name }}</strong><br>
<span class="small">{{ catalogue[effect.name].title }}; {{ effect.family }}</span></td>
<td>{% for name, p in effect.parameters.items() %}{{ name }} = {{ p.in_words() }}<br>{% endfor %}</td>
<td class="n">{{ "%.0f" | format(effect.delta_deviance) }}</td><td class="n">{{ p_values[effect.name] }}</td>
<td>{{ effect.equivalent | join(", ") or "–" }}</td><td>{{ effect.separate_by }}</td></tr>
{% endfor %}
</table>
<p class="small">Gain: by how much the penalised deviance (−2 log likelihood and a price for each parameter and jump)
gets worse without the effect; {{ accept_gain }} is asked for. p: the probability of as large a gain, over all effects
tried, where nothing is missing, from simulated records; beyond the largest of them an exponential tail, for two decades
and no further (then “≤”).</p>
{% for effect in result.effects %}
<p><strong>{{ effect.name }}.</strong> {{ catalogue[effect.name].description }} <span class="small">It shows as:
{{ catalogue[effect.name].signature }} Source: {{ catalogue[effect.name].source }}</span></p>
{% endfor %}
{% endif %}
{% if result.unexplained %}
<h2>Unexplained</h2>
<p>{{ result.unexplained.signature | capitalize }}, {{ result.unexplained.size_Nm | torque }} rms. No effect of the
catalogue explains it.</p>
{% endif %}

<h2>What the extension gains</h2>
<p class="small">Every figure is from held-out blocks: coefficients fitted on the other blocks, jumps segmented afresh
at the same price in all models.</p>
<table>
<tr><th>model</th><th class="n">held-out RMSE</th><th class="n">log score per sample</th>
<th class="n">gain over the row above [95 %]</th><th class="n">jumps needed</th></tr>
{% for rung in rungs %}
<tr><td>{{ rung.name }}</td><td class="n">{{ rung.rmse_Nm | torque }}</td><td class="n">{{
"%.4f" | format(rung.log_score) }}</td><td class="n">{% if rung.gain is not none %}{{ "%+.4f" | format(rung.gain) }}
[{{ "%+.4f" | format(rung.gain_low) }}, {{ "%+.4f" | format(rung.gain_high) }}]{% else %}–{% endif %}</td>
<td class="n">{{ rung.jumps }}</td></tr>
{% endfor %}
{% for name, worth in noise_gains %}
<tr><td>+ {{ name }} (noise)</td><td class="n">the same</td><td class="n">–</td>
<td class="n">{{ "%+.4f" | format(worth) }}, in sample</td><td class="n">the same</td></tr>
{% endfor %}
</table>
{{ ladder_picture | safe }}
{% if result.gain and result.gain.diagnosis %}
<p>On labelled windows with the effect in them, the diagnosis goes from
{{ "%.1f" | format(100 * result.gain.diagnosis.before.detection) }} % detection and
{{ "%.1f" | format(100 * result.gain.diagnosis.before.false_positive) }} % false positives to
{{ "%.1f" | format(100 * result.gain.diagnosis.after.detection) }} % and
{{ "%.1f" | format(100 * result.gain.diagnosis.after.false_positive) }} %.</p>
{% endif %}

<h2>The residual from every side</h2>
<p class="small">Orange-red circles: simulation as it is, with the jumps of the extended one. Teal squares: extended.
Bars are two standard errors. The number is the probability of as much scatter by chance.</p>
<div class="views">
{% for view, picture in views %}
<figure>{{ picture | safe }}<figcaption>as it is: <span class="{{ "sure" if view.base.p_value < sure_p }}">p = {{
"%.1e" | format(view.base.p_value) }}</span>, extended: <span class="{{ "sure" if view.extended.p_value < sure_p }}">p =
{{ "%.1e" | format(view.extended.p_value) }}</span>. Would show {{ view.question }}.</figcaption></figure>
{% endfor %}
</div>

{% if plan %}
<h2>What to fly next</h2>
<table>
<tr><th>manoeuvre</th><th class="n">separation [nats]</th><th>hardest to tell apart there</th></tr>
{% for entry in plan %}
<tr><td><strong>{{ entry.name }}</strong><br><span class="small">{{ entry.description }}</span></td>
<td class="n">{{ "%.1f" | format(entry.separation) }}</td>
<td>{{ entry.worst_pair[0] }}{% if entry.worst_pair[1] %} and {{ entry.worst_pair[1] }}{% else %} from the simulation as
it is{% endif %}</td></tr>
{% endfor %}
</table>
{% endif %}

{% if result.untested %}
<h2>What these data could not test</h2>
<table><tr><th>effect</th><th>missing</th></tr>
{% for effect, missing in result.untested %}<tr><td>{{ effect }}</td><td>{{ missing }}</td></tr>
{% endfor %}
</table>
{% endif %}

{% if detectable %}
<h2>What these data would have shown</h2>
<p class="small">The smallest strength at which each effect that was not named would have been, its shape in the middle
of what this motion can show, and how much of all friction (rms) that is; to within a factor of about two.</p>
<table><tr><th>effect</th><th>from</th><th class="n">of all friction</th></tr>
{% for entry in detectable %}<tr><td>{{ entry.name }}</td><td>{{ entry.parameter }} = {{ entry.strength | number }}
{{ entry.unit if entry.unit != "-" }}</td><td class="n">{{ "%.2g" | format(100 * entry.share) }} %</td></tr>
{% endfor %}
</table>
{% endif %}

{% if extended_toml %}
<h2>The extended wheel</h2>
<p class="small">Also beside this page as <code>extended_wheel.toml</code>; it loads wherever a wheel loads.</p>
{% for line in laws %}<p>{{ line }}</p>
{% endfor %}
<pre>{{ extended_toml }}</pre>
{% endif %}
</body>
</html>
"""
