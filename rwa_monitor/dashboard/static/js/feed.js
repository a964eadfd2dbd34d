/** The live feed: one WebSocket, opened again by itself; says when it is gone. */
const QUIET_MS = 4000; // the server beats every second
const RETRY_MS = 1000;

export class Feed {
  constructor(store, onChange) {
    this.store = store;
    this.onChange = onChange;
    this.connected = false;
    this.note = "";
    this.since = Date.now();
    this.watched = "";
    this.heard = 0;
    this.open();
    setInterval(() => {
      if (this.connected && Date.now() - this.heard > QUIET_MS) this.socket.close();
    }, 1000);
  }

  open() {
    this.socket = new WebSocket(`ws://${location.host}/api/feed`);
    this.socket.onmessage = (event) => {
      this.heard = Date.now();
      if (!this.connected) {
        this.connected = true;
        this.send();
      }
      for (const entry of JSON.parse(event.data)) {
        if (entry.key === "dashboard/beat") {
          this.store.now = entry.message.wall_ns / 1e6;
          this.note = entry.message.note;
        } else this.store.apply(entry);
      }
      this.onChange();
    };
    this.socket.onclose = () => {
      if (this.connected) this.since = Date.now();
      this.connected = false;
      this.onChange();
      setTimeout(() => this.open(), RETRY_MS);
    };
  }

  watch(name) {
    this.watched = name;
    this.send();
  }

  send() {
    if (this.connected && this.socket.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify({ watch: this.watched }));
  }
}
