"""The page of the discrepancy report (Jinja); see report.py for what goes in."""

from typing import Final

STYLE: Final = """
:root { color-scheme: light; }
body { font: 16px/1.5 system-ui, sans-serif; color: #1c1c1c; background: #fff; margin: 0 auto; max-width: 1120px;
  padding: 1.5rem; overflow-wrap: break-word; }
h1 { font-size: 1.5rem; margin: 0 0 .3rem; line-height: 1.25; } h2 { font-size: 1.2rem; margin: 2.2rem 0 .5rem; }
h3 { font-size: 1rem; margin: 1rem 0 .2rem; }
.verdict { border-left: .5rem solid #888; background: #f5f5f3; padding: .8rem 1rem; font-size: 1.15rem; }
.verdict.inadequate { border-color: #c1440e; } .verdict.adequate { border-color: #2b7a3d; }
table { border-collapse: collapse; margin: .5rem 0; } th, td { padding: .3rem .8rem .3rem 0; text-align: left;
  border-bottom: 1px solid #ddd; vertical-align: top; } th { font-size: .9rem;
  vertical-align: bottom; } td.n, th.n { text-align: right; font-variant-numeric: tabular-nums; }
td.n { white-space: nowrap; }
code { font-size: .88em; } td:first-child code { white-space: nowrap; }
.views { display: grid; grid-template-columns: repeat(auto-fill, minmax(min(330px, 100%), 1fr)); gap: 1.2rem; }
figure { margin: 0; } figcaption { font-size: .85rem; color: #444; }
svg { max-width: 100%; height: auto; display: block; }
.wide { overflow-x: auto; } .wide svg { min-width: 40rem; }
pre { background: #f5f5f3; padding: .8rem; overflow-x: auto; font-size: .85rem; }
.small { color: #555; font-size: .9em; } .sure { color: #a8380a; font-weight: 600; }
.line::first-letter { text-transform: uppercase; }
@media (max-width: 640px) {
  body { padding: 1rem; }
  table, tbody, tr, td { display: block; } tr:first-child { display: none; }
  tr { border-bottom: 2px solid #ccc; padding: .4rem 0; }
  td, td.n { border: 0; padding: .15rem 0; text-align: left; white-space: normal; }
  td[data-label]::before { content: attr(data-label) ": "; color: #555; font-size: .85rem; }
}
@media print {
  body { font-size: 10pt; max-width: none; padding: 0; } table { font-size: 9pt; } h2, h3 { break-after: avoid; }
  figure, tr, .verdict { break-inside: avoid; } .views { grid-template-columns: repeat(2, 1fr); }
  .wide svg { min-width: 0; } pre { white-space: pre-wrap; } .verdict { -webkit-print-color-adjust: exact; }
}
"""

MISSING: Final = """
{% if result.effects %}
<h2>What is missing</h2>
<table>
<tr><th>effect</th><th>parameters</th><th class="n">gain</th><th class="n">p</th><th>indistinguishable from</th>
<th>what would separate them</th></tr>
{% for effect in result.effects %}
<tr><td><strong>{{ effect_class(effect.name).title }}</strong><br><span class="small">{{ kinds[effect.family] }},
<code>{{ effect.name }}</code></span></td>
<td data-label="parameters">{% for name, p in effect.parameters.items() %}{{ in_words(name, p.unit) }}
{{ measure(p.value, p.std, p.unit) }}{{ " (" ~ p.note ~ ")" if p.note }}<br>{% endfor %}</td>
<td class="n" data-label="gain">{{ "%.0f" | format(effect.delta_deviance) }}</td>
<td class="n" data-label="p">{{ p_values[effect.name] }}</td>
<td data-label="indistinguishable from">{% for name in effect.equivalent %}{{ effect_class(name).title }}
(<code>{{ name }}</code>){{ ", " if not loop.last }}{% else %}–{% endfor %}</td>
<td data-label="what would separate them">{{ effect.separate_by | replace("`", "") }}</td></tr>
{% endfor %}
</table>
<p class="small">± one standard error. Gain: by how much the penalised deviance (−2 log likelihood and a price for each
parameter and jump) gets worse without the effect; {{ accept_gain }} is asked for. p: the probability of as large a
gain, over all effects tried, where nothing is missing, from simulated records; beyond the largest of them an
exponential tail, for two decades and no further (then “≤”). Names in <code>this type</code> are those of files and
commands.</p>
{% endif %}
{% if result.unexplained %}
<h2>Unexplained</h2>
<p>{{ result.unexplained.signature | capitalize }}, {{ result.unexplained.size_Nm | torque }} rms. No effect of the
catalogue explains it; what is named beside it may be a stand-in.</p>
{% endif %}
"""

GAINS: Final = """
<h2>What the extension {{ "loses" if result.gain and result.gain.is_a_loss else "gains" }}</h2>
<p class="small">{% if result.gain and result.gain.held_out %}Measured on {{ result.gain.held_out | join(", ") }}, where
nothing was searched or fitted{% else %}Every figure is from held-out blocks: coefficients fitted on the other
blocks{% endif %}; levels and jumps segmented afresh at the same price in all models. Log score: the mean logarithm of
the probability density that the model gives a sample, jumps charged; 0.01 a sample over 10,000 samples are odds of
e<sup>100</sup>. Jumps needed: a smooth effect that is missing is paid for with false jumps.</p>
<table>
<tr><th>model</th><th class="n">held-out RMSE</th><th class="n">beyond the noise</th><th class="n">log score [nats per
sample]</th><th class="n">gain over the row above [95 %]</th><th class="n">jumps needed</th></tr>
{% for rung in rungs %}
<tr><td>{{ rung.name }}</td><td class="n" data-label="held-out RMSE">{{ rung.rmse_Nm | torque }}</td>
<td class="n" data-label="beyond the noise">{{ rung.excess_Nm | torque }}</td>
<td class="n" data-label="log score [nats per sample]">{{ "%.4f" | format(rung.log_score) }}</td>
<td class="n" data-label="gain over the row above [95 %]">{% if rung.gain is not none %}{{ "%+.4f" | format(rung.gain)
}} [{{ "%+.4f" | format(rung.gain_low) }}, {{ "%+.4f" | format(rung.gain_high) }}]{% else %}–{% endif %}</td>
<td class="n" data-label="jumps needed">{{ rung.jumps }}</td></tr>
{% endfor %}
{% for name, worth in noise_gains %}
<tr><td>+ {{ name }} (noise)</td><td class="n" data-label="held-out RMSE">the same</td>
<td class="n" data-label="beyond the noise">the same</td><td class="n" data-label="log score [nats per sample]">–</td>
<td class="n" data-label="gain over the row above">{{ "%+.4f" | format(worth) }}, in sample</td>
<td class="n" data-label="jumps needed">the same</td></tr>
{% endfor %}
</table>
<figure class="wide">{{ ladder_picture | safe }}</figure>
{% if result.gain and result.gain.searched_again %}
{% set words = result.gain.searched_again.in_words() %}
<p>{{ words[:1] | upper }}{{ words[1:] }}.</p>
{% endif %}
{% if result.gain and result.gain.diagnosis %}
<h3>What it does to the diagnosis</h3>
<p class="small">{{ result.gain.diagnosis.windows }} windows simulated with the effects in them, on motion like the
recorded, half of them with one anomaly; each diagnosed without and with the effects known.</p>
<table>
<tr><th>diagnosis</th><th class="n">anomalies detected</th><th class="n">false positives</th>
<th class="n">false changepoints per window</th></tr>
{% for name, rates in (("without the extension", result.gain.diagnosis.before),
("with it", result.gain.diagnosis.after)) %}
<tr><td>{{ name }}</td><td class="n" data-label="anomalies detected">{{ "%.0f" | format(100 * rates.detection) }} %</td>
<td class="n" data-label="false positives">{{ "%.1f" | format(100 * rates.false_positive) }} %</td>
<td class="n" data-label="false changepoints per window">{{ "%.1f" | format(rates.false_changepoints) }}</td></tr>
{% endfor %}
</table>
{% endif %}
"""

NEXT: Final = """
<h2>What to fly next</h2>
{% for line in plan.advice %}<p>{{ line[0] | upper }}{{ line[1:] }}.</p>
{% endfor %}
{% if plan.manoeuvres %}
<p>To {{ plan.question }}:</p>
<p class="small">Separation: the expected difference of log likelihood between the two causes that stay closest; above
about 5 nats the data decide.</p>
<table>
<tr><th>manoeuvre</th><th class="n">minutes</th><th class="n">separation [nats]</th><th class="n">nats an hour</th>
<th>hardest there</th></tr>
{% for entry in plan.manoeuvres %}
<tr><td><strong>{{ entry.name | capitalize }}</strong><br><span class="small">{{ entry.description }}</span></td>
<td class="n" data-label="minutes">{{ "%.0f" | format(entry.duration_s / 60) }}</td>
<td class="n" data-label="separation [nats]">{{ ("%.0f" if entry.separation >= 10 else "%.1f") |
format(entry.separation) }}</td>
<td class="n" data-label="nats an hour">{{ ("%.0f" if entry.nats_per_hour >= 10 else "%.1f") |
format(entry.nats_per_hour) }}</td>
<td data-label="hardest there">{{ effect_class(entry.worst_pair[0]).title }}{% if entry.worst_pair[1] %} and
{{ effect_class(entry.worst_pair[1]).title }}{% endif %}
{% if entry.shows %}<br><span class="small">shows {{ entry.shows | join(", ") }}</span>{% endif %}</td></tr>
{% endfor %}
</table>
{% endif %}

{% if result.untested %}
<h2>What these data could not test</h2>
<p class="small">Not excited: the motion, or the number of jumps, does not show it. Not testable: a channel or a part of
the wheel file is missing, and no motion would show it. What was tested and not seen stands further down.</p>
<table><tr><th>effect</th><th>why</th><th>what is missing</th></tr>
{% for effect, missing in result.untested %}<tr><td>{{ effect_class(effect).title }}<br><code class="small">{{ effect
}}</code></td><td data-label="why">{{ "not testable" if effect in not_testable else "not excited" }}</td>
<td data-label="what is missing">{{ missing | replace("`", "") }}</td></tr>
{% endfor %}
</table>
{% endif %}

{% if extended_toml %}
<h2>The extended model</h2>
<p><code>extended_wheel.toml</code>, beside this page and printed at its end, is the wheel with the effects found; it
loads wherever a wheel loads (<code>--wheel</code> of every command).</p>
{% for line in laws %}<p class="small line">{{ line }}.</p>
{% endfor %}
{% endif %}
"""

BACKGROUND: Final = """
<h2>The residual from every side</h2>
<p class="small">Orange-red circles: simulation as it is, with the jumps of the extended one. Teal squares: extended.
Bars are two standard errors. p is the probability of as much scatter by chance; below {{ sure_p | probability }} it is
<span class="sure">set off</span>.</p>
<div class="views">
{% for view, picture in views %}
<figure>{{ picture | safe }}<figcaption>As it is: <span class="{{ "sure" if view.base.p_value < sure_p }}">p {{
view.base.p_value | probability }}</span>; extended: <span class="{{ "sure" if view.extended.p_value < sure_p }}">p {{
view.extended.p_value | probability }}</span>. Would show {{ view.question }}.</figcaption></figure>
{% endfor %}
</div>

{% if detectable %}
<h2>Tested and not seen: what these data would have shown</h2>
<p class="small">The smallest strength at which each effect that was not named would have been, its shape in the middle
of what this motion can show, and how much of all friction (rms) that is; to within a factor of about two.</p>
<table><tr><th>effect</th><th>named from</th><th class="n">of all friction</th></tr>
{% for entry in detectable %}<tr><td>{{ effect_class(entry.name).title }}
<code class="small">{{ entry.name }}</code></td>
<td data-label="named from">{{ in_words(entry.parameter, entry.unit) }} {{ measure(entry.strength, none, entry.unit)
}}</td><td class="n" data-label="of all friction">{{ "%.2g" | format(100 * entry.share) }} %</td></tr>
{% endfor %}
</table>
{% endif %}

{% if result.effects %}
<h2>The effects named</h2>
{% for effect in result.effects %}
<h3>{{ effect_class(effect.name).title }}</h3>
<figure>{{ formulas[effect.name] | safe or effect_class(effect.name).formula }}</figure>
<p>{{ effect_class(effect.name).description | replace("`", "") }}
<span class="small">It shows as: {{ effect_class(effect.name).signature | replace("`", "") }}
Source: {{ effect_class(effect.name).source | replace("`", "") }}</span></p>
{% endfor %}
{% endif %}

{% if extended_toml %}
<h2>extended_wheel.toml</h2>
<pre>{{ extended_toml }}</pre>
{% endif %}
"""

PAGE: Final = (
    """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>What the simulation of {{ wheel.name }} gets wrong</title>
<style>"""
    + STYLE
    + """</style>
</head>
<body>
<h1>What the simulation of wheel “{{ wheel.name }}” gets wrong</h1>
<p class="small">{{ sources | join(", ") }} · {{ samples }} samples in motion
{%- if left_out %} ({{ left_out }}){% endif %}{% if clipped %}, {{ clipped }} outliers pulled in{% endif %} · noise
{{ noise_std_Nm | torque }}{% if steps %} ({{ steps }}; taken out as far as the readings allow){%
endif %} · {{ software }}</p>
<p class="verdict {{ result.verdict }}"><strong>{{ result.verdict | capitalize }}.</strong> {{ sentence }}{% if
extended_toml and not result.gain.is_a_loss and not result.gain.simulated.is_a_loss %} On data held out, the log
score of a sample rises by {{
"%.3g" | format(rungs[-1].total) }} ± {{ "%.1g" | format(rungs[-1].total_half) }} (95 %){% if rungs[0].jumps %}, and
{{ rungs[0].jumps }} jumps become {{ rungs[-1].jumps }}{% endif %}.{% endif %}</p>

<h2>Measured and simulated</h2>
{% if overlay %}
<figure class="wide">{{ overlay | safe }}</figure>
{% else %}
<p>This report has no pictures: matplotlib is missing (<code>pip install 'rwa-monitor[plot]'</code>).</p>
{% endif %}

<h2>Friction over speed</h2>
<p class="small">Means over narrow ranges of speed, all jumps taken out: at the lowest level of dry friction. Where it
differs between growing and falling speed, it has a memory or follows the acceleration.</p>
<figure class="wide">{{ friction_over_speed | safe }}</figure>
"""
    + MISSING
    + GAINS
    + NEXT
    + BACKGROUND
    + """</body>
</html>
"""
)
