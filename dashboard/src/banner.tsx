/** At the top of the page, readable from across the room: the service's state, the structure's, why, and how old the last datum is. */
import { useEffect, useState } from "preact/hooks";
import { levelLook, quietLook, stateLook } from "./colour";
import { clock, duration, given, prettyUnits } from "./format";
import { banner as bannerOf, bannerWords, levelWords, structure, type Structure } from "./state";
import type { Store } from "./store";

/** The age counts on between data: only this part of the page is drawn for it. */
const tick = 250;

export function BannerView({ store }: { store: Store }) {
  const [, redraw] = useState(0);
  useEffect(() => {
    const timer = setInterval(() => redraw((n) => n + 1), tick);
    return () => clearInterval(timer);
  }, []);
  const { connected, lostAt, lastDatumAt, status, model } = store;
  const { latest } = store.history;
  const steps = model?.steps;
  const banner = bannerOf({ now: performance.now(), connected, lostAt, lastDatumAt, status, latest, model });
  const words = bannerWords(banner);
  const shown = words.join(" · ");
  useEffect(() => {
    document.title = `${shown} · ${[model?.site ?? "knothe", model?.test].filter(Boolean).join(" · ")}`;
  }, [shown, model?.site, model?.test]);
  const look = { ...stateLook, ...quietLook };
  const verdict = structure(status, latest);
  // That data arrive says nothing of a result that cannot be used: it must not be what is seen first.
  const calm = verdict !== undefined && verdict.level !== "ok" && shown === "OK";
  return (
    <section class={calm ? "banner calm" : "banner"} aria-label="State">
      <div class="words" role="status" aria-live="polite" id="state">
        {words.map((word) => (
          <div key={word} class="word" style={{ "--state": look[word].colour, "--ink": look[word].ink }}>
            <span aria-hidden="true">{look[word].sign}</span> {word}
          </div>
        ))}
      </div>
      <p class="reason" id="reason">
        {banner.reason}
      </p>
      <dl>
        {model?.test && (
          <div>
            <dt>test</dt>
            <dd>
              <a href="#tests" id="test">
                {model.test}
              </a>
            </dd>
          </div>
        )}
        <div>
          <dt>last datum</dt>
          <dd id="age">
            {Number.isFinite(banner.age) ? `${duration(banner.age)} ago` : "none yet"}
            {latest?.received_at !== undefined && <small> {clock(latest.received_at)}</small>}
          </dd>
        </div>
        <div>
          <dt>step</dt>
          <dd id="step">
            {latest ? latest.step : "–"}
            {latest && steps ? <small> of 0 … {steps - 1}</small> : ""}
          </dd>
        </div>
        <div>
          <dt>model time</dt>
          <dd>{latest ? `${given(latest.time)} ${prettyUnits(model?.time?.units)}`.trim() : "–"}</dd>
        </div>
        {(status?.quarantined ?? 0) > 0 && (
          <div>
            <dt>in quarantine</dt>
            <dd>
              <a href="#quarantine" id="quarantined">
                {status!.quarantined}
              </a>
            </dd>
          </div>
        )}
        {(status?.switched_off?.length ?? 0) > 0 && (
          <div>
            <dt>switched off</dt>
            <dd>
              <a href="#logbook" id="switched-off">
                sensor {status!.switched_off!.join(", ")}
              </a>
            </dd>
          </div>
        )}
      </dl>
      {verdict && <StructureView {...verdict} />}
    </section>
  );
}

/** Can the result be used: of the structure and its model, whatever the service's own state is. */
function StructureView({ level, reason }: Structure) {
  const look = levelLook[level];
  return (
    <>
      <div
        class="word structure"
        style={{ "--state": look.colour, "--ink": look.ink }}
        role="status"
        aria-live="polite"
        id="structure"
      >
        <span aria-hidden="true">{look.sign}</span> {levelWords[level]}
      </div>
      <p class="reason structure" id="verdict">
        {reason}
      </p>
    </>
  );
}
