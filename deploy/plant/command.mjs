// The service's decisions go to the test machine (docs/how-to/drive-a-machine.md). What is sent is in the spool first; a
// number that the machine has had is never sent again.

const TRIES = 3; // holds in a row that are not to learn, before somebody has to look

/** What of a decision makes it another one. A restart of the service gives the same. */
const key_of = ({ step, data, decision }) =>
  JSON.stringify([step, data, decision.action, decision.time, decision.load]);

const worst = ({ verdict }) => verdict?.reasons?.find(({ level }) => level === "reject")?.message ?? "";

export class Commander {
  /**
   * `command`: that part of the configuration; `spool`: where the commands are, and the data of a test that is driven;
   * `measure(machine, time, command)`: a datum; `log(message, about)`; `tell(message)`: who is in charge; `now()`: ms.
   */
  constructor(command, spool, { measure, log, tell = () => {}, now = Date.now }) {
    Object.assign(this, { command, spool, measure, log, tell, now });
    this.driven = "reached" in command;
    this.number = 0; // the last that was given to a command
    this.written = []; // commands that the machine has, the last one last; no more than two
    this.acknowledged = true;
    this.handled = null; // the decision that needs no further command
    this.held = null; // why nothing but hold is sent until somebody has looked
    this.released = -Infinity;
    this.deaf = false; // it does not take a hold: no heartbeat
    this.decided = now(); // when there last was a decision of all data, or none to wait for
    for (const order of spool.orders) this.recall(order);
    this.since = now();
  }

  get last() {
    return this.written.at(-1);
  }

  get armed() {
    return this.command.armed === true;
  }

  /** Of a driven test: the machine has stopped. */
  get stopped() {
    return (this.last?.action === "stop" && this.acknowledged) || this.would === "stop";
  }

  /** The decision on all that was sent is with the machine, or is held. */
  get settled() {
    return this.idle && this.viewed_at >= (this.spool.sent_at ?? 0);
  }

  recall(order) {
    if ("acknowledged" in order) this.acknowledged = true;
    else if ("dropped" in order) this.forget();
    else if ("held" in order) this.held = order.held;
    else if ("released" in order) {
      this.held = this.handled = null;
      this.released = Date.parse(order.released);
      // Whatever number the machine has now is right, and whatever it does may be cut short.
      const { set_point, place, journal } = this.last ?? {};
      if (this.last) this.written = [{ action: "load", set_point, place, journal }];
      this.acknowledged = true;
    } else this.count(order);
  }

  /** A command that the machine has, or is about to have; `set_point` and `place` (where to measure) stand until the next. */
  count(order) {
    const before = this.last;
    const { command, time } = order;
    const place = this.driven && time !== undefined ? { command, time } : before?.place;
    this.number = command;
    this.written = [before, { ...order, set_point: order.set_point ?? before?.set_point, place }];
    this.acknowledged = false;
    if (order.decision) this.handled = order.decision;
    // What a hold cut short is not done, unless it had been measured.
    if (order.interrupts && !this.is_measured()) this.handled = null;
  }

  /** The last command did not get to the machine. */
  forget() {
    this.written.pop();
    this.acknowledged = true;
    this.handled = this.last?.decision ?? null;
  }

  note(order) {
    this.spool.write(order);
    this.recall(order);
  }

  /** After a connection: every register or node is there; the counters go on from what the machine has. */
  async meet(machine) {
    const { set_point, action, sequence, acknowledge, reached, heartbeat } = this.command;
    const points = { set_point, action, sequence, acknowledge, ...(reached && { reached }), heartbeat };
    for (const name of Object.keys(points)) this[`${name}_now`] = await this.read(machine, name);
    this.beats = this.heartbeat_now;
    this.refused = false;
    this.put = null;
    if (this.number === 0) this.number = this.sequence_now;
    if (this.last?.command && this.acknowledged && this.acknowledge_now === this.last.command)
      this.log(`command ${this.last.command} (${this.last.action}): confirmed`);
  }

  async read(machine, name) {
    const { value, reason } = await machine.sample(name, { scale: 1, offset: 0, ...this.command[name] });
    if (value === null) throw new Error(`command.${name}: ${reason}`);
    return value;
  }

  /** One look at machine and service, and what follows from it. `view`: `{ status, line, at }`, or `{ trouble }`. */
  async tick(view, machine) {
    this.sequence_now = await this.read(machine, "sequence");
    this.acknowledge_now = await this.read(machine, "acknowledge");
    if (this.driven) this.reached_now = await this.read(machine, "reached");
    this.confirm();
    const reason = this.ending ?? this.held ?? this.reason_to_hold(view);
    this.idle = this.acknowledged;
    this.viewed_at = view.status ? view.at : -1;
    if (reason) await this.hold(machine, reason);
    else if (view.status) await this.follow(machine, view);
    const known = view.status && (view.status.structure || view.status.step === undefined);
    if (known && this.armed && !this.deaf) await this.beat(machine);
    this.ended = this.ending && (this.idle || this.deaf || !this.armed);
  }

  confirm() {
    if (!this.last?.command) return;
    const { command, action } = this.last;
    if (this.sequence_now !== command && !this.acknowledged && this.put !== command) {
      this.log(`command ${command} (${action}) did not get to the machine`);
      return this.note({ dropped: command, at: this.time() });
    }
    if (this.sequence_now !== command) {
      const why = `the machine's sequence number is ${this.sequence_now}, not ${command}`;
      return this.latch(`${why}: it was started again, or another program writes there`);
    }
    if (this.acknowledged) return;
    if (this.acknowledge_now === command) {
      this.note({ acknowledged: command, at: this.time() });
      this.deaf = false;
      this.since = this.now();
      return this.log(`command ${command} (${action}): acknowledged`);
    }
    if (this.now() - this.since <= 1000 * this.command.timeout) return;
    const why = `ALARM: command ${command} (${action}) is not acknowledged within ${this.command.timeout} s`;
    if (action === "load") return this.latch(why);
    if (!this.deaf) this.tell(why);
    this.deaf = true;
    this.log(`${why}: there is no heartbeat until it is`, "acknowledge");
  }

  /** Nothing but hold from now on: `--release` ends it. */
  latch(why) {
    if (this.held || !this.armed) return;
    this.tell(why);
    this.log(`${why}; held until somebody has looked (--release)`, "held");
    this.note({ held: why, at: this.time() });
  }

  reason_to_hold({ trouble, status, line }) {
    if (trouble) return `the service does not answer: ${trouble}`;
    if (!status) return null; // not yet for so long that it counts
    if (this.last?.journal && status.journal !== this.last.journal)
      return "the service serves another test, or another journal";
    if (status.state === "DIVERGED" || status.state === "FINISHED")
      return `the service is ${status.state}: ${status.reason}`;
    const { dead_time } = this.command;
    if (status.step === undefined || this.is_moving()) this.decided = this.now();
    if (status.step === undefined) return null;
    if (!status.structure) return "the verdict is not known";
    const decided = status.pending === 0 && status.behind === 0 && line.step === status.step;
    if (decided && !line.decision) return "the service decides nothing: the project has no [decide]";
    if (status.structure === "reject" && !(decided && line.decision.action !== "load"))
      return `the verdict is reject${line.step === status.step && worst(line) ? `: ${worst(line)}` : ""}`;
    if (decided) this.decided = this.now();
    else if (this.now() - this.decided > 1000 * dead_time)
      return `there is no decision of all data since ${dead_time} s`;
    return null;
  }

  /** Of a driven test: the last command is not done, or not measured yet. */
  is_moving() {
    return this.driven && this.last?.time !== undefined && !this.is_measured();
  }

  /** Of a driven test: the machine stands where the last datum was measured. */
  is_measured() {
    return this.last?.place !== undefined && this.spool.measured === this.last.place.command;
  }

  async hold(machine, why) {
    this.log(`held: ${why}`, "hold");
    if (this.last && this.last.action !== "load") return;
    await this.issue(machine, { action: "hold", why, interrupts: true });
  }

  async follow(machine, { status, line, at }) {
    if (!this.acknowledged) return void (this.idle = false);
    if (this.is_moving()) {
      this.idle = false;
      const { travel } = this.command;
      if (this.reached_now === this.last.command) this.begin_to_measure(machine);
      else if (this.now() - this.since > 1000 * travel)
        this.latch(`ALARM: command ${this.last.command} (${this.last.action}) is not done within ${travel} s`);
      return;
    }
    if (status.step === undefined) return this.begin(machine, status);
    const stored = this.spool.waiting.length + this.spool.unwritten.length === 0;
    const decided = status.pending === 0 && status.behind === 0 && line.step === status.step;
    if (!decided || at < this.spool.sent_at || (this.driven && !stored)) return void (this.idle = false);
    const key = key_of(line);
    if (key === this.handled || this.last?.action === "stop") return; // a stop is for good
    // A service that was started again does not know how long it has waited; then its clock and ours have to agree.
    const aged = 1000 * (status.data_age_s ?? at / 1000 - line.received_at) + this.now() - at;
    const age = Math.min(aged, this.now() - this.released);
    await this.issue(machine, { ...this.order(line, age / 1000), decision: key, journal: status.journal });
  }

  /** The first load of a driven test, which is the operator's. */
  async begin(machine, { journal }) {
    const { first } = this.command;
    if (!first || this.handled === "first" || this.spool.next > 0) return;
    const wrong = this.outside(first.set_point);
    const order = wrong ? { action: "hold", why: wrong } : { action: "load", ...first, why: "the first load" };
    await this.issue(machine, { ...order, decision: "first", journal });
  }

  /** What is to be done about the decision of a line, whose data are `age` s old. */
  order(line, age) {
    const { decision } = line;
    const { action, message } = decision;
    if (action === "stop") return { action, why: message };
    const again = { action: "hold", time: this.last?.place?.time ?? line.time }; // and measured again, if the test is driven
    const { dead_time } = this.command;
    if (age > dead_time) {
      const why = `the decision (${action}) is ${age.toFixed(1)} s old, dead_time is ${dead_time} s`;
      return this.is_measured()
        ? this.tried(again, why)
        : { action: "hold", why: `${why}: somebody has to look (--release)` };
    }
    if (action === "hold" && this.driven && decision.plan.length === 0) return this.tried(again, message);
    if (action === "hold") return { ...again, why: message };
    const { of = "load" } = this.command.set_point;
    const wrong =
      decision[of] === undefined
        ? 'the decision has no load, as the model does not know what is imposed: command.set_point.of "time" sends the time'
        : this.outside(decision[of]);
    if (wrong) return { action: "hold", why: `${wrong}: somebody has to look` };
    return { action, set_point: decision[of], time: decision.time, why: message };
  }

  /** A hold after which is measured again, until that was tried often enough. */
  tried(again, why) {
    const tries = (this.last?.tries ?? 0) + 1;
    if (tries <= TRIES) return { ...again, why, tries };
    return { action: "hold", why: `${why}; it was measured ${TRIES} times again: somebody has to look`, tries };
  }

  /** What forbids a set-point, in words, or null. */
  outside(set_point) {
    const { lower, upper, step } = this.command.limits;
    if (!(set_point >= lower && set_point <= upper))
      return `ALARM: the set-point ${set_point} is outside command.limits, ${lower} to ${upper}`;
    const { scale = 1, offset = 0 } = this.command.set_point;
    const before = this.last?.set_point ?? scale * this.set_point_now + offset;
    if (Math.abs(set_point - before) <= step * (1 + 1e-9)) return null;
    return `ALARM: the set-point ${set_point} is a step of ${Math.abs(set_point - before)} from ${before}, more than command.limits.step, ${step}`;
  }

  /** To the spool, then to the machine: the sequence number last, at whose change the machine acts. */
  async issue(machine, order) {
    this.idle = false;
    const what = `${order.action}${order.set_point === undefined ? "" : ` to ${order.set_point}`} (${order.why})`;
    if (!this.armed) {
      this.handled = order.decision ?? this.handled;
      this.idle = true;
      this.would = order.action;
      return this.log(`dry run ("armed" is not true): would send ${what}`, "dry run");
    }
    if (this.refused) return;
    const after = (number) => (number % 65535) + 1;
    const next = after(this.number);
    const command = next === this.sequence_now ? after(next) : next; // the machine acts where it changes
    const { action, set_point } = this.command;
    const journal = order.journal ?? this.last?.journal;
    this.note({ command, at: this.time(), ...order, ...(journal && { journal }) });
    this.since = this.now();
    this.log(`command ${command}: ${what}`, "command");
    this.tell(`command ${command}: ${what}`);
    const { scale = 1, offset = 0 } = set_point;
    const codes = { hold: 0, load: 1, stop: 2, ...action.codes };
    const writes = [
      ...(order.set_point === undefined ? [] : [["set_point", (order.set_point - offset) / scale]]),
      ["action", codes[order.action]],
      ["sequence", command],
    ];
    for (const [name, number] of writes) {
      const refusal = await machine.write(number, this.command[name]);
      if (refusal === undefined) {
        if (name === "sequence") this.put = command;
        continue;
      }
      this.refused = order.action !== "load"; // not even that: it is left alone until the next connection
      this.deaf ||= this.refused;
      return this.latch(`ALARM: command.${name}: the machine refuses ${number}: ${refusal}`);
    }
  }

  begin_to_measure(machine) {
    if (this.measuring || this.spool.unwritten.length > 0) return;
    const { command, time } = this.last;
    const work = this.measure(machine, time, command);
    this.measuring = work.finally(() => (this.measuring = null));
    this.measuring.catch(() => {}); // the connection is lost: measured again at the next one
  }

  async beat(machine) {
    if (this.now() < this.next_beat) return;
    this.next_beat = this.now() + 1000 * this.command.heartbeat.every - 1;
    this.beats = (this.beats + 1) % 65536;
    const refusal = await machine.write(this.beats, this.command.heartbeat);
    if (refusal) this.log(`command.heartbeat: the machine refuses it: ${refusal}`, "heartbeat");
  }

  time() {
    return new Date(this.now()).toISOString();
  }
}
