// Widgets of the page that Vuetify does not have: the 3D view, the detector image, the editor of
// criteria. They hold no data of their own; every answer comes from the program.
(function () {
  const call = (name, ...args) => window.trame.trigger(name, args);

  // -- 3D view: draws the scene here, or shows pictures that the program paints -----------------
  // Whoever is faster draws: the page measures its first second, then asks for pictures.
  const ENOUGH = 30, SLOW = 0.5, TRIAL_MS = 700, LARGEST = 2 ** 28;
  const RmView = {
    props: { version: { type: Number, default: 0 }, render: { type: String, default: "auto" } },
    template: `
      <div class="rm-view" ref="box" :style="{cursor: dragging ? 'grabbing' : 'default'}"
           tabindex="0" data-testid="view" :data-version="version" :data-painted="painted"
           :data-busy="pending" :data-drawn-by="own ? 'client' : 'server'" :data-rates="rates"
           @pointerdown="down" @pointermove="move" @pointerup="up" @pointercancel="up"
           @pointerleave="hideTip" @wheel.prevent="wheel" @dblclick="fit" @contextmenu.prevent
           @keydown="key">
        <canvas v-show="own" ref="canvas" data-testid="canvas"></canvas>
        <canvas v-show="own" ref="letters" class="rm-letters"></canvas>
        <img v-show="src && !own" :src="src" draggable="false" alt="scene with rays"/>
        <div v-if="slow" class="rm-spinner"></div>
        <div v-if="menu" class="rm-menu rm-at" ref="menu" role="menu" data-testid="scene-menu"
             :style="{left: menu.x + 'px', top: menu.y + 'px'}" @pointerdown.stop @dblclick.stop
             @keydown.stop="menuKey" @wheel.stop>
          <template v-for="group in menu.groups"><h4 v-if="group.title">{{ group.title }}</h4>
            <button v-for="[what, which, words] in group.entries" role="menuitem"
                    :data-testid="'gesture-' + what" @click="choose(what, which)">{{ words }}</button>
          </template></div>
        <div v-if="tip" class="rm-tip" :style="{left: tipX + 'px', top: tipY + 'px'}">{{ tip }}</div>
      </div>`,
    data: () => ({ src: null, painted: -1, pending: 0, slow: false, dragging: null, tip: "",
                   tipX: 0, tipY: 0, own: false, rates: "", menu: null }),
    created() {
      this.queue = null; this.again = false; this.fine = null; this.hover = null;
      this.spin = null; this.scene = null; this.resting = null; this.asked = 0;
    },
    mounted() {
      this.observer = new ResizeObserver(() => this.refresh());
      this.observer.observe(this.$refs.box);
      if (this.render !== "server") this.open();
      this.refresh();
    },
    beforeUnmount() { this.observer.disconnect(); },
    watch: { version() { this.refresh(); } },
    methods: {
      size() {
        const box = this.$refs.box.getBoundingClientRect();
        return { width: Math.round(box.width), height: Math.round(box.height),
                 ratio: Math.min(window.devicePixelRatio || 1, 2) };
      },
      refresh() { if (this.scene) this.pull(); else this.request({}); },

      // -- drawn here ----------------------------------------------------------------------------
      open() {
        try {
          this.scene = new window.RaymapScene.Scene(this.$refs.canvas);
          this.scene.letters = this.$refs.letters;
          this.$refs.box.raymapScene = this.scene;
        } catch (error) {
          this.scene = null;  // pictures of the program instead
        }
      },
      // Get what the page does not hold; one request at a time
      async pull() {
        if (this.pending) { this.again = true; return; }
        const { width, height, ratio } = this.size();
        if (width < 8 || height < 8) return;
        this.pending = 1;
        const version = this.version;
        try {
          const scene = this.scene;
          const news = await call("rm_scene", { width, height, have: { ...scene.have } });
          if (!news) return;
          scene.resize(width, height, ratio);
          let whole = true;
          for (const part of news.parts) {
            const data = part.bytes > LARGEST ? null : await this.bytes(part);
            if (part.bytes > LARGEST) { this.giveUp(); return; }
            if (data) scene.take(part, data); else whole = false;
          }
          if (scene.lost) { this.giveUp(); return; }
          if (!whole) this.again = true;
          else if (!scene.ready) return;
          else if (!this.own && !(await this.decide())) return;
          else { scene.paint(); this.painted = version; }
        } finally {
          this.pending = 0;
          const more = this.again || this.version !== version;
          this.again = false;
          if (more) this.refresh();
        }
      },
      // The bytes of a part, in chunks where they are many; null where they came too late
      async bytes(part) {
        if (part.data) return new Uint8Array(await plain(part.data));
        const whole = new Uint8Array(part.bytes);
        let at = 0;
        while (at < part.bytes) {
          const chunk = await call("rm_chunk", part.name, part.revision, at);
          const data = chunk && new Uint8Array(await plain(chunk));
          if (!data || !data.length) return null;
          whole.set(data, at);
          at += data.length;
        }
        return whole;
      },
      // Whether this page draws: measured against pictures of the program, once
      async decide() {
        this.own = true;
        if (this.render === "client") return true;
        await this.$nextTick();
        // The first picture compiles; where it takes long, another would, too
        const first = this.scene.rate(0);
        const here = first < SLOW ? first : this.scene.rate(TRIAL_MS);
        let there = 0;
        if (here < ENOUGH) {
          const ask = { ...this.size(), coarse: true };
          await call("rm_frame", ask);
          const start = performance.now();
          for (let i = 0; i < 2; i++) await call("rm_frame", ask);
          there = 2000 / (performance.now() - start);
        }
        this.rates = `${here.toFixed(1)} ${there.toFixed(1)}`;
        if (here >= there) return true;
        this.giveUp();
        return false;
      },
      giveUp() { this.scene = null; this.own = false; this.again = true; },
      moved(camera) {
        this.scene.camera = camera;
        this.scene.draw();
        clearTimeout(this.resting);
        // While the mouse holds the scene nothing is sent
        if (!this.dragging) this.resting = setTimeout(() => this.tell(), 150);
      },
      tell() {
        clearTimeout(this.resting);
        this.resting = null;
        call("rm_eye", { ...this.size(), camera: this.scene.camera });
      },
      act(action) {
        if (!this.own) { this.request({ ...action, coarse: true }); return; }
        const { width, height } = this.size(), { Camera } = window.RaymapScene;
        let camera = this.scene.camera;
        if (action.orbit) camera = Camera.orbit(camera, ...action.orbit, height);
        if (action.pan) camera = Camera.pan(camera, ...action.pan, height);
        if (action.zoom) {
          const { x = width / 2, y = height / 2 } = action;
          camera = Camera.zoom(camera, action.zoom, x, y, width, height);
        }
        this.moved(camera);
      },

      // -- pictures of the program: one request at a time, what the mouse does meanwhile adds up ---
      async request(action) {
        const waiting = this.queue;
        if (waiting) {
          action = { ...waiting, ...action,
            orbit: add(waiting.orbit, action.orbit), pan: add(waiting.pan, action.pan),
            zoom: (waiting.zoom || 1) * (action.zoom || 1) };
        }
        if (this.pending) {
          this.queue = action;
          // A fine picture takes long, and is of no use once the scene moves
          if (this.finely && action.coarse) { this.finely = false; call("rm_hurry"); }
          return;
        }
        const size = this.size();
        if (size.width < 8 || size.height < 8) return;
        this.queue = null;
        this.pending = 1;
        this.finely = !action.coarse;
        const version = this.version;
        clearTimeout(this.spin);
        this.spin = setTimeout(() => { this.slow = true; }, 400);
        try {
          const reply = await call("rm_frame", { ...size, ...action });
          // Another tab may have given it up
          if (reply && !reply.image && !this.queue) this.queue = {};
          if (reply && reply.image) {
            const old = this.src;
            this.src = URL.createObjectURL(new Blob([reply.image], { type: reply.type }));
            if (old) setTimeout(() => URL.revokeObjectURL(old), 1000);
            if (!reply.coarse) this.painted = version;
            clearTimeout(this.fine);
            if (reply.coarse) this.fine = setTimeout(() => this.request({}), 160);
          }
        } finally {
          this.pending = 0; clearTimeout(this.spin); this.slow = false;
          if (this.queue || this.version !== version) {
            const next = this.queue || {}; this.queue = null; this.request(next);
          }
        }
      },

      // -- the mouse -------------------------------------------------------------------------------
      place(event) {
        const box = this.$refs.box.getBoundingClientRect();
        return [event.clientX - box.left, event.clientY - box.top];
      },
      // Where the picture on the page is seen from, for the picker of the program
      sight(x, y) {
        const at = { ...this.size(), x, y };
        return this.own ? { ...at, camera: this.scene.camera } : at;
      },
      // What can be done with what is under the mouse
      async offer(x, y) {
        this.hideTip();
        const found = await call("rm_offer", this.sight(x, y));
        if (!found || !found.groups.length) { this.menu = null; return; }
        this.menu = { groups: found.groups, x, y };
        await this.$nextTick();
        const box = this.$refs.box, menu = this.$refs.menu;
        this.menu.x = Math.max(0, Math.min(x, box.clientWidth - menu.offsetWidth - 4));
        this.menu.y = Math.max(0, Math.min(y, box.clientHeight - menu.offsetHeight - 4));
        menu.querySelector("button").focus();
      },
      choose(what, which) {
        this.menu = null;
        this.$refs.box.focus();
        call("rm_gesture", what, which);
      },
      menuKey(event) {
        const all = [...this.$refs.menu.querySelectorAll("button")];
        const at = all.indexOf(document.activeElement);
        const step = { ArrowDown: 1, ArrowUp: -1 }[event.key];
        if (event.key === "Escape") { this.menu = null; this.$refs.box.focus(); }
        else if (step) {
          event.preventDefault();
          all[(at + step + all.length) % all.length].focus();
        }
      },
      down(event) {
        this.hideTip();
        this.menu = null;
        this.$refs.box.setPointerCapture(event.pointerId);
        const [x, y] = this.place(event);
        this.dragging = { x, y, x0: x, y0: y, moved: false,
                          pan: event.button !== 0 || event.shiftKey || event.ctrlKey };
        if (this.scene) this.scene.held = true;
      },
      move(event) {
        const [x, y] = this.place(event);
        const drag = this.dragging;
        if (!drag) { this.rest(x, y); return; }
        if (!drag.moved && Math.hypot(x - drag.x0, y - drag.y0) < 4) return;
        drag.moved = true;
        const step = [x - drag.x, y - drag.y];
        drag.x = x; drag.y = y;
        this.act({ [drag.pan ? "pan" : "orbit"]: step });
      },
      up(event) {
        const drag = this.dragging;
        this.dragging = null;
        if (this.scene) this.scene.held = false;
        if (!drag) return;
        if (drag.moved && this.own) this.tell();
        const [x, y] = this.place(event);
        if (!drag.moved && event.type === "pointerup" && event.button === 0) {
          call("rm_pick", this.sight(x, y));
        }
        if (!drag.moved && event.type === "pointerup" && event.button === 2) this.offer(x, y);
      },
      wheel(event) {
        const [x, y] = this.place(event);
        const step = Math.max(-1, Math.min(1, -event.deltaY / 100));
        this.act({ zoom: Math.pow(1.2, step), x, y });
      },
      key(event) {
        const turns = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
        const turn = turns[event.key];
        if (turn) {
          const step = this.size().height / (event.altKey ? 180 : 36);
          this.act({ [event.shiftKey ? "pan" : "orbit"]: [turn[0] * step, turn[1] * step] });
        } else if (event.key === "+" || event.key === "-") {
          this.act({ zoom: event.key === "+" ? 1.2 : 1 / 1.2 });
        } else if (event.key === "Home") this.fit();
        else return;
        event.preventDefault();
      },
      fit() { call("rm_camera", "fit"); },
      rest(x, y) {
        this.hideTip();
        this.hover = setTimeout(async () => {
          const text = await call("rm_hover", this.sight(x, y));
          if (text && !this.dragging) {
            const width = this.$refs.box.clientWidth;
            this.tipX = Math.min(x + 14, width - 220); this.tipY = y + 14; this.tip = text;
          }
        }, 120);
      },
      hideTip() { clearTimeout(this.hover); this.tip = ""; },
    },
  };
  // Bytes of an answer, however they came
  const plain = async (data) => (data instanceof Blob ? data.arrayBuffer() : data);
  const add = (a, b) => (a && b ? [a[0] + b[0], a[1] + b[1]] : a || b);

  // -- detector image with a region drawn by the mouse -----------------------------------------
  const RmImage = {
    props: { src: String, cells: Array, region: Object, shape: { type: String, default: "rect" },
             label: String, testid: String },
    emits: ["region", "place"],
    template: `
      <div class="rm-image" ref="box" :data-testid="testid"
           @pointerdown="down" @pointermove="move" @pointerup="up" @pointercancel="drag = null"
           @pointerleave="$emit('place', null)">
        <img :src="src" draggable="false" :alt="label"/>
        <svg :viewBox="'0 0 ' + cells[0] + ' ' + cells[1]" preserveAspectRatio="none">
          <template v-if="shown">
            <rect v-if="shown.shape === 'rect'" :x="Math.min(shown.values[0], shown.values[2])"
                  :y="cells[1] - Math.max(shown.values[1], shown.values[3])"
                  :width="Math.abs(shown.values[2] - shown.values[0])"
                  :height="Math.abs(shown.values[3] - shown.values[1])"/>
            <ellipse v-else :cx="shown.values[0]" :cy="cells[1] - shown.values[1]"
                     :rx="shown.values[2]" :ry="shown.values[3]"/>
          </template>
        </svg>
        <span class="rm-image-label">{{ label }}</span>
      </div>`,
    data: () => ({ drag: null }),
    computed: {
      shown() { return this.drag ? this.shapeOf(this.drag) : this.region; },
    },
    methods: {
      cell(event) {
        const box = this.$refs.box.getBoundingClientRect();
        const x = (event.clientX - box.left) / box.width * this.cells[0];
        const y = (1 - (event.clientY - box.top) / box.height) * this.cells[1];
        return [Math.min(Math.max(x, 0), this.cells[0]), Math.min(Math.max(y, 0), this.cells[1])];
      },
      shapeOf(d) {
        if (this.shape === "rect") {
          return { shape: "rect", values: [Math.min(d.x0, d.x1), Math.min(d.y0, d.y1),
                                           Math.max(d.x0, d.x1), Math.max(d.y0, d.y1)] };
        }
        return { shape: "ellipse", values: [(d.x0 + d.x1) / 2, (d.y0 + d.y1) / 2,
                 Math.abs(d.x1 - d.x0) / 2, Math.abs(d.y1 - d.y0) / 2] };
      },
      down(event) {
        if (event.button !== 0) return;
        event.preventDefault();
        this.$refs.box.setPointerCapture(event.pointerId);
        const [x, y] = this.cell(event);
        this.drag = { x0: x, y0: y, x1: x, y1: y };
      },
      move(event) {
        const [x, y] = this.cell(event);
        this.$emit("place", [Math.min(Math.floor(x), this.cells[0] - 1),
                             Math.min(Math.floor(y), this.cells[1] - 1)]);
        if (this.drag) this.drag = { ...this.drag, x1: x, y1: y };
      },
      up() {
        const drag = this.drag;
        this.drag = null;
        if (!drag) return;
        const size = Math.min(Math.abs(drag.x1 - drag.x0), Math.abs(drag.y1 - drag.y0));
        if (size >= 1) this.$emit("region", this.shapeOf(drag));
      },
    },
  };

  // -- editor of a criterion: completion of names, errors with a caret --------------------------
  const RmEditor = {
    props: { text: { type: String, default: "" }, error: Object },
    template: `
      <div class="rm-editor" :class="{wrong: error}">
        <span class="rm-editor-mark" aria-hidden="true">{{ error ? "!" : "?" }}</span>
        <input ref="box" v-model="draft" spellcheck="false" autocomplete="off" data-testid="criterion"
               aria-label="criterion" placeholder='all rays — try: detected("sensor")'
               @input="changed" @keydown="key" @blur="later" @click="complete" />
        <div v-if="items.length" class="rm-completions" data-testid="completions">
          <div v-for="(item, i) in items" :class="{chosen: i === chosen}"
               @mousedown.prevent="take(i)"><b>{{ item.text }}</b><i>{{ item.kind }}</i></div>
        </div>
        <div v-else-if="error" class="rm-editor-error" data-testid="criterion-error">
          <pre v-if="error.caret">{{ error.caret }}</pre><div>{{ error.message }}</div>
        </div>
      </div>`,
    data() { return { items: [], chosen: -1, from: 0, of: "", draft: this.text }; },
    created() { this.timer = null; this.asked = 0; },
    // What the program says replaces the draft, unless it merely repeats what was typed here
    watch: { text(value) { if (value !== this.draft.trim()) this.draft = value; } },
    methods: {
      send(now) {
        clearTimeout(this.timer);
        const value = this.draft;
        this.timer = setTimeout(() => call("rm_criterion", value), now ? 0 : 180);
      },
      changed() { this.send(false); this.complete(); },
      later() { this.items = []; },
      async complete() {
        const box = this.$refs.box, number = ++this.asked;
        const text = box.value, reply = await call("rm_complete", text, box.selectionStart);
        if (number !== this.asked || document.activeElement !== box) return;
        this.items = reply.items; this.from = reply.from; this.of = text; this.chosen = -1;
      },
      key(event) {
        if (event.key === "Escape") { this.items = []; return; }
        if (event.key === "Enter") {
          if (this.items.length && this.chosen >= 0) { event.preventDefault(); this.take(this.chosen); }
          else { this.items = []; this.send(true); }
          return;
        }
        if (!this.items.length) return;
        if (event.key === "ArrowDown" || event.key === "ArrowUp") {
          event.preventDefault();
          const step = event.key === "ArrowDown" ? 1 : -1, n = this.items.length;
          this.chosen = (this.chosen + step + n) % n;
        } else if (event.key === "Tab") {
          event.preventDefault();
          // Who types faster than proposals come means those for what stands there now
          if (this.of === this.draft) this.take(Math.max(this.chosen, 0));
          else this.complete().then(() => { if (this.items.length) this.take(0); });
        }
      },
      take(i) {
        if (this.of !== this.draft) return;
        const box = this.$refs.box, item = this.items[i];
        const tail = this.draft.slice(box.selectionStart);
        this.draft = this.draft.slice(0, this.from) + item.insert + tail;
        const caret = this.from + item.insert.length - (item.back || 0);
        this.items = [];
        this.$nextTick(() => {
          box.focus(); box.setSelectionRange(caret, caret);
          this.send(false); this.complete();
        });
      },
    },
  };

  // -- keeps the session in the address, restores it, counts the tabs ---------------------------
  const RmSession = {
    props: { address: { type: String, default: "" }, file: Object },
    template: "<span></span>",
    mounted() {
      // The client takes the token out of the address, where a cookie stands for it from now on. In
      // the frame of a notebook there may be no cookie, and no address that anybody sees: put it back
      const opened = performance.getEntriesByType("navigation")[0];
      const secret = opened && new URL(opened.name).searchParams.get("secret");
      if (secret && window.top !== window) {
        const url = new URL(window.location);
        url.searchParams.set("secret", secret);
        window.history.replaceState({}, document.title, url);
      }
      const session = window.location.hash.slice(1);
      if (session) call("rm_restore", session);
      call("rm_hello");
      // Undo and redo; a field of text has its own
      this.onKey = (event) => {
        if (!(event.ctrlKey || event.metaKey) || event.target.matches("input, textarea, select")) return;
        const key = event.key.toLowerCase(), again = key === "y" || (key === "z" && event.shiftKey);
        if (!again && key !== "z") return;
        event.preventDefault();
        call(again ? "rm_redo" : "rm_undo");
      };
      window.addEventListener("keydown", this.onKey);
      this.onHash = () => call("rm_restore", window.location.hash.slice(1));
      window.addEventListener("hashchange", this.onHash);
    },
    beforeUnmount() {
      window.removeEventListener("hashchange", this.onHash);
      window.removeEventListener("keydown", this.onKey);
    },
    watch: {
      address(value) {
        const url = new URL(window.location);
        url.hash = value;
        window.history.replaceState({}, document.title, url);
      },
      // A file that the program made for the person at this page
      file(value) {
        if (!value) return;
        const link = document.createElement("a");
        link.href = URL.createObjectURL(new Blob([value.data], { type: value.type }));
        link.download = value.name;
        link.click();
        setTimeout(() => URL.revokeObjectURL(link.href), 5000);
      },
    },
  };

  const RmUpload = {
    props: { testid: String },
    template: `<label class="rm-upload"><slot/><input type="file" accept=".json" :data-testid="testid"
               @change="read"/></label>`,
    methods: {
      async read(event) {
        const file = event.target.files[0];
        event.target.value = "";
        if (file) call("rm_load", await file.text());
      },
    },
  };

  window.RaymapWidgets = {
    install(app) {
      app.component("rm-view", RmView);
      app.component("rm-image", RmImage);
      app.component("rm-editor", RmEditor);
      app.component("rm-session", RmSession);
      app.component("rm-upload", RmUpload);
    },
  };
})();
