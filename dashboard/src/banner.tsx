/** At the top of the page, readable from across the room: the state, why, and how old the last datum is. */
import { stateLook } from "./colour";
import { duration, given } from "./format";
import type { Banner } from "./state";
import type { StepLine } from "./types";

interface Props {
  banner: Banner;
  latest: StepLine | undefined;
  steps: number | undefined;
}

export function BannerView({ banner, latest, steps }: Props) {
  const look = stateLook[banner.state];
  return (
    <section class="banner" style={{ "--state": look.colour, "--ink": look.ink }} aria-label="State">
      <div class="word" role="status" aria-live="polite" id="state">
        <span aria-hidden="true">{look.sign}</span> {banner.state}
      </div>
      <p class="reason" id="reason">{banner.reason}</p>
      <dl>
        <div>
          <dt>last datum</dt>
          <dd id="age">{Number.isFinite(banner.age) ? `${duration(banner.age)} ago` : "none yet"}</dd>
        </div>
        <div>
          <dt>step</dt>
          <dd id="step">{latest ? latest.step : "–"}{latest && steps ? <small> of 0 … {steps - 1}</small> : ""}</dd>
        </div>
        <div>
          <dt>model time</dt>
          <dd>{latest ? given(latest.time) : "–"}</dd>
        </div>
      </dl>
    </section>
  );
}
