// From the samples of channels, each at its own rate, to one datum at each time of the model.

// Samples further apart than so many of the channel's intervals say nothing of the time between them: one may be lost.
const GAP = 2.5;

/** The value at `instant`, by a line between two samples: null if one is bad, undefined if they are far apart. */
function between(left, right, instant, longest) {
  if (right.stamp === instant) return right.value;
  if (!left || right.stamp - left.stamp > longest) return undefined;
  if (left.value === null || right.value === null) return null;
  return left.value + ((right.value - left.value) * (instant - left.stamp)) / (right.stamp - left.stamp);
}

export class Assembly {
  /**
   * `instants`: Unix time of each time of the model, ms, increasing; the first that is not in the spool is `next`. A
   * channel without a sample `wait` ms after an instant, by the stamps of the others, has none there.
   */
  constructor(instants, channels, next, wait) {
    Object.assign(this, { instants, next, wait, newest: -Infinity, rows: new Map() });
    this.channels = new Map(
      Object.entries(channels).map(([name, { every }]) => [name, { longest: GAP * 1000 * every, next, last: null }]),
    );
  }

  /** From when on this channel's samples are of use, Unix time in ms. */
  since(name) {
    const { last, longest } = this.channels.get(name);
    return last ? last.stamp : this.instants[Math.min(this.next, this.instants.length - 1)] - longest;
  }

  /** How long there was no sample before this one, ms, if that is too long to tell what was between. */
  gap(name, stamp) {
    const { last, longest } = this.channels.get(name);
    return last && stamp - last.stamp > longest ? stamp - last.stamp : 0;
  }

  get done() {
    return this.next === this.instants.length;
  }

  /** A sample (null: bad) with its source's time stamp; the data that are complete with it. Not newer: ignored. */
  add(name, stamp, value) {
    const channel = this.channels.get(name);
    if (channel.last && stamp <= channel.last.stamp) return [];
    const right = { stamp, value };
    for (
      let k = Math.max(channel.next, this.next);
      k < this.instants.length && this.instants[k] <= stamp;
      channel.next = ++k
    ) {
      const found = between(channel.last, right, this.instants[k], channel.longest);
      if (found === undefined) continue;
      if (!this.rows.has(k)) this.rows.set(k, {});
      this.rows.get(k)[name] = {
        value: found,
        stamps: [...(channel.last && stamp !== this.instants[k] ? [channel.last.stamp] : []), stamp],
      };
    }
    channel.last = right;
    this.newest = Math.max(this.newest, stamp);
    return this.complete();
  }

  complete() {
    const data = [];
    while (!this.done && this.instants[this.next] <= this.newest) {
      const waited = this.instants[this.next] + this.wait < this.newest;
      if (!waited && [...this.channels.values()].some((channel) => channel.next <= this.next)) break;
      if (this.rows.has(this.next)) data.push({ seq: this.next, channels: this.rows.get(this.next) });
      this.rows.delete(this.next++);
    }
    return data;
  }
}
