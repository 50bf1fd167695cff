// Draws the scene on the page's own graphics card (WebGL 2): parts with revisions come from the
// program, the camera belongs to the page while it turns. A picture is at most a dozen draw calls,
// whatever the number of bodies and rays.
(function () {
  const VIEW_ANGLE = 30, NEAR_SHARE = 1e-3, OPAQUE = 254, BODY_ROW = 256;

  // -- vectors and the camera: the arithmetic of the program, in doubles ------------------------
  const sub = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
  const along = (a, s, b) => [a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]];
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2],
                           a[0] * b[1] - a[1] * b[0]];
  const unit = (a) => { const n = Math.hypot(...a); return [a[0] / n, a[1] / n, a[2] / n]; };
  const distanceOf = (height) => 0.5 * height / Math.tan(0.5 * VIEW_ANGLE * Math.PI / 180);

  function axes(camera) {
    const forward = unit(sub(camera.focal_point, camera.position));
    const right = unit(cross(forward, camera.view_up));
    return { right, up: cross(right, forward), forward };
  }

  const Camera = {
    // Turn around the focal point as a trackball; the picture's height is half a turn
    orbit(camera, dx, dy, height) {
      const { right, up, forward } = axes(camera);
      const yaw = -Math.PI * dx / height, pitch = -Math.PI * dy / height;
      const turn = (v) => rotate(rotate(v, up, yaw), right, pitch);
      const distance = Math.hypot(...sub(camera.focal_point, camera.position));
      return { ...camera, view_up: turn(up),
               position: along(camera.focal_point, -distance, turn(forward)) };
    },
    pan(camera, dx, dy, height) {
      const { right, up } = axes(camera), step = camera.height / height;
      const shift = along(along([0, 0, 0], dy * step, up), -dx * step, right);
      return { ...camera, position: along(camera.position, 1, shift),
               focal_point: along(camera.focal_point, 1, shift) };
    },
    // Enlarge; the point of the focal plane under the pixel stays where it is
    zoom(camera, factor, x, y, width, height) {
      const tall = Math.min(Math.max(camera.height / factor, 1e-9), 1e12);
      const share = (1 - tall / camera.height) * camera.height / height;
      const { right, up, forward } = axes(camera);
      const focal = along(along(camera.focal_point, (x - width / 2) * share, right),
                          -(y - height / 2) * share, up);
      return { ...camera, height: tall, focal_point: focal,
               position: along(focal, -distanceOf(tall), forward) };
    },
  };

  // Rodrigues
  function rotate(v, axis, angle) {
    const c = Math.cos(angle), s = Math.sin(angle);
    return along(along([c * v[0], c * v[1], c * v[2]], s, cross(axis, v)),
                 (1 - c) * dot(axis, v), axis);
  }

  // World (relative to the centre of the scene) to clip space, column by column
  function matrixOf(camera, center, aspect, reach) {
    const { right, up, forward } = axes(camera);
    const focal = sub(camera.focal_point, center);
    const tall = camera.height / 2, wide = tall * aspect;
    const rows = [
      [...right.map((v) => v / wide), -dot(right, focal) / wide],
      [...up.map((v) => v / tall), -dot(up, focal) / tall],
    ];
    const middle = -dot(forward, focal);  // of the scene, beyond the focal plane
    if (camera.parallel) {
      rows.push([...forward.map((v) => v / reach), (-dot(forward, focal) - middle) / reach]);
      rows.push([0, 0, 0, 1]);
    } else {
      const distance = distanceOf(camera.height);
      const far = Math.max(distance + middle + reach, 1e-9);
      const near = Math.max(distance + middle - reach, NEAR_SHARE * far);
      const a = (far + near) / (far - near), b = -2 * far * near / (far - near);
      const w = [...forward.map((v) => v / distance), 1 - dot(forward, focal) / distance];
      rows.push(w.map((v, i) => a * v + (i === 3 ? b / distance : 0)));
      rows.push(w);
    }
    const flat = new Float32Array(16);
    for (let i = 0; i < 4; i++) for (let j = 0; j < 4; j++) flat[4 * j + i] = rows[i][j];
    return { flat, right, up, forward,
             eye: along(focal, -distanceOf(camera.height), forward) };
  }

  // -- shaders -----------------------------------------------------------------------------------
  const HEAD = "#version 300 es\nprecision highp float;precision highp int;\n";
  const NOWHERE = "gl_Position=vec4(2.,2.,2.,1.);";
  const LOOK = `uniform sampler2D looks;
    vec4 look(uint body){return texelFetch(looks,ivec2(int(body)%${BODY_ROW},int(body)/${BODY_ROW}),0);}`;
  const EDGE = `uniform bool dark;vec4 edge(vec4 c,float strength){
    vec3 tone=dark?c.rgb*.75+.25:c.rgb*.35;float a=c.a>0.?strength*min(1.,.35+c.a):0.;return vec4(tone*a,a);}`;
  const KEEP = "uniform vec4 cut;bool gone(vec3 p){return dot(cut.xyz,p)>cut.w;}";
  const PLAIN = `in vec4 tone;in vec3 place;out vec4 color;${KEEP}
    void main(){if(tone.a<=0.||gone(place))discard;color=tone;}`;

  const SHADERS = {
    ground: [`void main(){vec2 p=vec2(gl_VertexID==1?3.:-1.,gl_VertexID==2?3.:-1.);gl_Position=vec4(p,0.,1.);}`,
      `uniform vec3 top;uniform vec3 bottom;uniform float tall;out vec4 color;
       void main(){color=vec4(mix(bottom,top,gl_FragCoord.y/tall),1.);}`],
    body: [`layout(location=0)in vec3 p;layout(location=1)in vec3 n;layout(location=2)in uint body;
       uniform mat4 m;out vec3 normal;out vec3 place;flat out vec4 tone;${LOOK}
       void main(){gl_Position=m*vec4(p,1.);normal=n;place=p;tone=look(body);}`,
      `in vec3 normal;in vec3 place;flat in vec4 tone;uniform mat3 frame;uniform bool solid;out vec4 color;${KEEP}
       void main(){if(gone(place))discard;
         vec3 n=normalize(frame*normal);if(n.z>0.)n=-n;
         float lit=max(0.,dot(n,vec3(-.30,-.45,-.84)));
         float a=tone.a,shine=.25*pow(lit,24.);
         if(solid)a=1.;else{float g=1.+n.z;a=a+(1.-a)*.55*g*g*g*sqrt(a);shine*=a;}
         color=vec4(min(vec3(1.),tone.rgb*(.38+.62*lit)+shine)*a,a);}`],
    edge: [`layout(location=0)in vec3 p;layout(location=2)in uint body;uniform mat4 m;uniform float strength;
       out vec4 tone;out vec3 place;${LOOK}${EDGE}
       void main(){gl_Position=m*vec4(p,1.);place=p;tone=edge(look(body),strength);}`, PLAIN],
    outline: [`layout(location=0)in vec3 a;layout(location=1)in vec3 b;layout(location=2)in uint body;
       layout(location=3)in vec3 n1;layout(location=4)in vec3 n2;
       uniform mat4 m;uniform vec3 eye;uniform vec3 forward;uniform bool parallel;
       out vec4 tone;out vec3 place;${LOOK}${EDGE}
       void main(){vec3 sight=parallel?forward:a-eye;place=gl_VertexID==0?a:b;tone=edge(look(body),.8);
         if(dot(n1,sight)*dot(n2,sight)<0.)gl_Position=m*vec4(place,1.);else{${NOWHERE}}}`, PLAIN],
    // Wide lines: a strip of two triangles for each segment, one pixel wider for its soft rim
    wide: [`layout(location=0)in vec3 a;layout(location=1)in vec3 b;layout(location=2)in vec4 rgba;
       uniform mat4 m;uniform vec2 half_size;uniform float width;uniform float near;uniform vec4 only;
       out vec4 tone;out vec3 place;out float beside;
       void main(){
         vec4 p=m*vec4(a,1.),q=m*vec4(b,1.);
         vec4 c=only.a>0.?only:rgba;
         if(c.a<=0.||(p.w<near&&q.w<near)){${NOWHERE}return;}
         float s=0.,t=1.;
         if(p.w<near)s=(near-p.w)/(q.w-p.w);
         if(q.w<near)t=(near-p.w)/(q.w-p.w);
         vec4 e=mix(p,q,s),f=mix(p,q,t);
         vec2 along=(f.xy/f.w-e.xy/e.w)*half_size;float l=length(along);along=l>0.?along/l:vec2(1.,0.);
         bool last=(gl_VertexID&1)==1;beside=(gl_VertexID<2?-1.:1.)*(width*.5+.5);
         vec4 r=last?f:e;r.xy+=vec2(-along.y,along.x)*beside/half_size*r.w;
         gl_Position=r;place=mix(a,b,last?t:s);tone=vec4(c.rgb*c.a,c.a);}`,
      `in vec4 tone;in vec3 place;in float beside;uniform float width;out vec4 color;${KEEP}
       void main(){if(gone(place))discard;color=tone*clamp(width*.5+.5-abs(beside),0.,1.);}`],
    thin: [`layout(location=0)in vec3 p;layout(location=2)in vec4 rgba;uniform mat4 m;
       flat out vec4 tone;out vec3 place;
       void main(){gl_Position=m*vec4(p,1.);place=p;tone=vec4(rgba.rgb*rgba.a,rgba.a);}`,
      `flat in vec4 tone;in vec3 place;out vec4 color;${KEEP}
       void main(){if(tone.a<=0.||gone(place))discard;color=tone;}`],
    ring: [`uniform mat4 m;uniform vec3 p;uniform float size;void main(){gl_Position=m*vec4(p,1.);gl_PointSize=size;}`,
      `uniform float size;out vec4 color;void main(){float r=length(gl_PointCoord-.5)*size;
       float k=clamp(1.75-abs(r-size*.5+3.),0.,1.);color=vec4(1.,.36,.36,1.)*k;}`],
  };

  const VIEWS = { f4: Float32Array, i1: Int8Array, u1: Uint8Array, u2: Uint16Array };

  class Scene {
    // Throws where the page has no WebGL 2
    constructor(canvas) {
      this.canvas = canvas;
      const gl = this.gl = canvas.getContext("webgl2", { antialias: true, alpha: false,
        powerPreference: "high-performance", preserveDrawingBuffer: false });
      if (!gl) throw new Error("no WebGL 2");
      this.many = gl.getExtension("WEBGL_multi_draw");
      const info = gl.getExtension("WEBGL_debug_renderer_info");
      this.drawnBy = String(gl.getParameter(info ? info.UNMASKED_RENDERER_WEBGL : gl.RENDERER));
      this.parts = {}; this.have = {}; this.buffers = {}; this.camera = null;
      this.frames = 0; this.calls = 0; this.wanted = false; this.lost = false;
      this.programs = {};
      for (const [name, [vertex, fragment]] of Object.entries(SHADERS)) {
        this.programs[name] = this._program(vertex, fragment);
      }
      this.looks = gl.createTexture();
      canvas.addEventListener("webglcontextlost", () => { this.lost = true; });
    }

    _program(vertex, fragment) {
      const gl = this.gl, program = gl.createProgram();
      for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
        const shader = gl.createShader(kind);
        gl.shaderSource(shader, HEAD + text);
        gl.compileShader(shader);
        gl.attachShader(program, shader);
      }
      gl.linkProgram(program);
      if (!gl.getProgramParameter(program, gl.LINK_STATUS)) {
        const logs = gl.getAttachedShaders(program).map((shader) => gl.getShaderInfoLog(shader));
        throw new Error(`shader: ${gl.getProgramInfoLog(program)} ${logs.join(" ")}`);
      }
      const places = {};
      const n = gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS);
      for (let i = 0; i < n; i++) {
        const { name } = gl.getActiveUniform(program, i);
        places[name] = gl.getUniformLocation(program, name);
      }
      return { program, places };
    }

    // Take over a part, for the next picture; what is older than what is held is dropped
    take(part, data) {
      if (part.revision <= (this.have[part.name] || 0)) return false;
      const bytes = data.buffer ? data : new Uint8Array(data);
      const arrays = {};
      for (const { name, kind, shape, offset } of part.arrays) {
        const count = shape.reduce((a, b) => a * b, 1);
        const size = count * VIEWS[kind].BYTES_PER_ELEMENT;
        arrays[name] = new VIEWS[kind](bytes.slice(offset, offset + size).buffer, 0, count);
      }
      this.have[part.name] = part.revision;
      this.parts[part.name] = { ...part.header, count: this._upload(part.name, arrays) };
      if (part.name === "bodies") Object.assign(this.parts.bodies, part.header);
      if (part.name === "camera" && !this.held) this.camera = part.header;
      if (part.name === "colors") this._index(arrays.rgba);
      if (part.name === "looks") { this.alphas = arrays.rgba.filter((_, i) => i % 4 === 3); }
      return true;
    }

    _buffer(name, array, target) {
      const gl = this.gl, kind = target || gl.ARRAY_BUFFER;
      if (!this.buffers[name]) this.buffers[name] = gl.createBuffer();
      gl.bindVertexArray(null);
      gl.bindBuffer(kind, this.buffers[name]);
      gl.bufferData(kind, array, gl.STATIC_DRAW);
      return this.buffers[name];
    }

    // A vertex array of (location, buffer, size, type, normalised, stride, offset, per instance)
    _vertices(name, ...attributes) {
      const gl = this.gl;
      this.vertices = this.vertices || {};
      const made = this.vertices[name] = this.vertices[name] || gl.createVertexArray();
      gl.bindVertexArray(made);
      for (const [at, buffer, size, type, normal, stride, offset, instanced] of attributes) {
        gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
        gl.enableVertexAttribArray(at);
        if (type === gl.UNSIGNED_SHORT) gl.vertexAttribIPointer(at, size, type, stride, offset);
        else gl.vertexAttribPointer(at, size, type, normal, stride, offset);
        gl.vertexAttribDivisor(at, instanced ? 1 : 0);
      }
      gl.bindVertexArray(null);
    }

    // Puts a part's arrays on the card; returns how many things they hold
    _upload(name, arrays) {
      const gl = this.gl, F = gl.FLOAT, U = gl.UNSIGNED_SHORT, B = gl.BYTE, C = gl.UNSIGNED_BYTE;
      if (name === "bodies") {
        const p = this._buffer("bp", arrays.position), n = this._buffer("bn", arrays.normal);
        const b = this._buffer("bb", arrays.body);
        this._vertices("bodies", [0, p, 3, F, false, 12, 0], [1, n, 3, B, true, 4, 0],
                       [2, b, 1, U, false, 2, 0]);
        return arrays.body.length;
      }
      if (name === "edges" || name === "cut") {
        const p = this._buffer(name + "p", arrays.position), b = this._buffer(name + "b", arrays.body);
        this._vertices(name, [0, p, 3, F, false, 12, 0], [2, b, 1, U, false, 2, 0]);
        return arrays.body.length;
      }
      if (name === "outlines") {
        const p = this._buffer("op", arrays.position), n = this._buffer("on", arrays.normal);
        const b = this._buffer("ob", arrays.body);
        this._vertices(name, [0, p, 3, F, false, 24, 0, true], [1, p, 3, F, false, 24, 12, true],
                       [2, b, 1, U, false, 2, 0, true], [3, n, 3, B, true, 8, 0, true],
                       [4, n, 3, B, true, 8, 4, true]);
        return arrays.body.length;
      }
      if (name === "rays") {
        this._buffer("rp", arrays.position);
        return arrays.position.length / 3;
      }
      if (name === "colors") {
        // One colour ahead: the last point of a segment gives a thin line its colour
        const ahead = new Uint8Array(arrays.rgba.length + 4);
        ahead.set(arrays.rgba, 4);
        const p = this.buffers.rp, c = this._buffer("rc", ahead);
        this._vertices("wide", [0, p, 3, F, false, 12, 0, true], [1, p, 3, F, false, 12, 12, true],
                       [2, c, 4, C, true, 4, 4, true]);
        this._vertices("thin", [0, p, 3, F, false, 12, 0], [2, c, 4, C, true, 4, 0]);
        return arrays.rgba.length / 4;
      }
      if (name === "chosen") {
        this.marked = arrays.position;
        const p = this._buffer("cp", arrays.position);
        this._vertices("chosen", [0, p, 3, F, false, 12, 0, true], [1, p, 3, F, false, 12, 12, true]);
        return arrays.position.length / 3;
      }
      if (name === "looks") {
        const n = arrays.rgba.length / 4, rows = Math.max(1, Math.ceil(n / BODY_ROW));
        const padded = new Uint8Array(4 * BODY_ROW * rows);
        padded.set(arrays.rgba);
        gl.bindTexture(gl.TEXTURE_2D, this.looks);
        gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, BODY_ROW, rows, 0, gl.RGBA, C, padded);
        gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
        gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
        return n;
      }
      return 0;
    }

    // Ends of the segments that have a colour, for thin lines
    _index(rgba) {
      const gl = this.gl, n = rgba.length / 4, ends = new Uint32Array(2 * n);
      let k = 0;
      for (let i = 0; i < n - 1; i++) if (rgba[4 * i + 3]) { ends[k++] = i; ends[k++] = i + 1; }
      this._buffer("ri", ends.subarray(0, k), gl.ELEMENT_ARRAY_BUFFER);
      gl.bindVertexArray(this.vertices.thin);
      gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, this.buffers.ri);
      gl.bindVertexArray(null);
      this.ends = k;
    }

    // -- pictures --------------------------------------------------------------------------------
    // Size of the panel [pixels of the page] and device pixels per pixel of the page
    resize(width, height, ratio) {
      this.ratio = ratio;
      const size = [Math.max(1, Math.round(width * ratio)), Math.max(1, Math.round(height * ratio))];
      if (this.canvas.width !== size[0] || this.canvas.height !== size[1]) {
        [this.canvas.width, this.canvas.height] = size;
        this.draw();
      }
    }

    // Whether all that a picture needs is there
    get ready() {
      return !this.lost && this.camera !== null && ["bodies", "edges", "outlines", "rays", "looks",
        "colors", "section", "cut", "chosen", "style"].every((name) => this.parts[name]);
    }

    // One picture soon, however often it is asked for
    draw() {
      if (this.wanted) return;
      this.wanted = true;
      requestAnimationFrame(() => { this.wanted = false; this.paint(); });
    }

    paint() {
      if (!this.ready) return;
      const gl = this.gl, parts = this.parts, { width, height } = this.canvas, ratio = this.ratio || 1;
      const reach = 1.01 * Math.max(parts.bodies.reach, parts.rays.reach, 1e-9);
      const style = parts.style, section = parts.section;
      const view = matrixOf(this.camera, style.center, width / height, reach);
      const { flat, right, up, forward } = view;
      // Normals to right, down, forward; column by column
      const frame = [0, 1, 2].flatMap((i) => [right[i], -up[i], forward[i]]);
      const plane = section.on ? [...section.normal, section.offset] : [0, 0, 0, 1];
      const all = { m: flat, frame, dark: style.dark, forward, eye: view.eye, looks: 0,
                    parallel: this.camera.parallel, half_size: [width / 2, height / 2], near: 1e-3 };
      this.calls = 0;
      gl.viewport(0, 0, width, height);
      gl.bindFramebuffer(gl.FRAMEBUFFER, null);
      gl.depthMask(true);
      gl.clear(gl.DEPTH_BUFFER_BIT);
      gl.disable(gl.CULL_FACE);
      gl.disable(gl.DEPTH_TEST);
      gl.disable(gl.BLEND);
      gl.activeTexture(gl.TEXTURE0);
      gl.bindTexture(gl.TEXTURE_2D, this.looks);
      const ground = style.dark ? [[.075, .090, .115], [.035, .043, .058]]
                                : [[1, 1, 1], [.93, .945, .96]];
      this._use("ground", { top: ground[0], bottom: ground[1], tall: height });
      this._call(() => gl.drawArrays(gl.TRIANGLES, 0, 3));

      // Opaque bodies by depth; rays that lie in them are not hidden by them
      const { solid, clear } = this._ranges(forward);
      gl.enable(gl.DEPTH_TEST);
      gl.depthFunc(gl.LEQUAL);
      if (solid.length) {
        gl.enable(gl.POLYGON_OFFSET_FILL);
        gl.polygonOffset(1, 4);
        this._use("body", { ...all, cut: plane, solid: true });
        this._triangles(solid);
        gl.disable(gl.POLYGON_OFFSET_FILL);
      }
      // Translucent ones from back to front: their far sides, then their near sides
      gl.enable(gl.BLEND);
      gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
      gl.depthMask(false);
      if (clear.length) {
        gl.enable(gl.CULL_FACE);
        this._use("body", { ...all, cut: plane, solid: false });
        for (const side of [gl.FRONT, gl.BACK]) { gl.cullFace(side); this._triangles(clear); }
        gl.disable(gl.CULL_FACE);
      }

      const free = section.on && section.rays ? plane : [0, 0, 0, 1];
      const line = style.width * ratio;
      if (this.ends && line <= 1.3) {
        this._use("thin", { ...all, cut: free });
        gl.bindVertexArray(this.vertices.thin);
        this._call(() => gl.drawElements(gl.LINES, this.ends, gl.UNSIGNED_INT, 0));
      } else if (this.ends) {
        this._use("wide", { ...all, cut: free, width: line, only: [0, 0, 0, 0] });
        gl.bindVertexArray(this.vertices.wide);
        this._call(() => gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, parts.rays.count - 1));
      }
      this._use("edge", { ...all, cut: plane, strength: 0.55 });
      this._lines("edges", parts.edges.count);
      // The outline of the cut lies in the plane: nothing of it is cut away
      if (parts.cut.count) {
        this._use("edge", { ...all, cut: [0, 0, 0, 1], strength: 0.55 });
        this._lines("cut", parts.cut.count);
      }
      if (parts.outlines.count) {
        this._use("outline", { ...all, cut: plane });
        gl.bindVertexArray(this.vertices.outlines);
        this._call(() => gl.drawArraysInstanced(gl.LINES, 0, 2, parts.outlines.count));
      }
      this._chosen(all, ratio);
      if (this.letters) this.written = window.RaymapLettering.letter(this.letters, this, view);
      this.frames++;
    }

    _chosen(all, ratio) {
      const gl = this.gl, { chosen, style } = this.parts;
      if (chosen.count < 2) return;
      gl.disable(gl.DEPTH_TEST);
      const tone = style.dark ? [1, 1, 1, 1] : [.08, .08, .08, 1];
      this._use("wide", { ...all, cut: [0, 0, 0, 1], width: (style.width + 1.2) * ratio, only: tone });
      gl.bindVertexArray(this.vertices.chosen);
      this._call(() => gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, chosen.count - 1));
      if (chosen.point === null) return;
      const place = Array.from(this.marked.subarray(3 * chosen.point, 3 * chosen.point + 3));
      this._use("ring", { ...all, p: place, size: 20 * ratio });
      gl.bindVertexArray(null);
      this._call(() => gl.drawArrays(gl.POINTS, 0, 1));
    }

    _call(draw) { this.calls++; draw(); }

    _lines(name, count) {
      if (!count) return;
      this.gl.bindVertexArray(this.vertices[name]);
      this._call(() => this.gl.drawArrays(this.gl.LINES, 0, count));
    }

    // Bodies that hide, and those that shine through, the farthest first
    _ranges(forward) {
      const { first, count, middle } = this.parts.bodies, solid = [], clear = [];
      for (let i = 0; i < first.length; i++) {
        if (!this.alphas[i] || !count[i]) continue;
        const range = { first: first[i], count: count[i], depth: dot(middle[i], forward) };
        (this.alphas[i] >= OPAQUE ? solid : clear).push(range);
      }
      clear.sort((a, b) => b.depth - a.depth);
      return { solid, clear };
    }

    _triangles(ranges) {
      const gl = this.gl;
      gl.bindVertexArray(this.vertices.bodies);
      if (this.many) {
        const firsts = Int32Array.from(ranges, (r) => r.first);
        const counts = Int32Array.from(ranges, (r) => r.count);
        this._call(() => this.many.multiDrawArraysWEBGL(gl.TRIANGLES, firsts, 0, counts, 0,
                                                        ranges.length));
      } else {
        for (const r of ranges) this._call(() => gl.drawArrays(gl.TRIANGLES, r.first, r.count));
      }
    }

    _use(name, values) {
      const gl = this.gl, { program, places } = this.programs[name];
      gl.useProgram(program);
      for (const [key, at] of Object.entries(places)) {
        const value = values[key];
        if (key === "m") gl.uniformMatrix4fv(at, false, value);
        else if (key === "frame") gl.uniformMatrix3fv(at, false, value);
        else if (typeof value === "boolean" || key === "looks") gl.uniform1i(at, value ? 1 : 0);
        else if (typeof value === "number") gl.uniform1f(at, value);
        else gl[`uniform${value.length}fv`](at, value);
      }
    }

    // Pictures a second, from whole pictures within the given time (at least one)
    rate(milliseconds) {
      const gl = this.gl, pixel = new Uint8Array(4), start = performance.now();
      let n = 0;
      while (n < 1 || (performance.now() - start < milliseconds && n < 60)) {
        this.paint();
        gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel);  // waits for the card
        n++;
      }
      return 1000 * n / Math.max(performance.now() - start, 0.1);
    }
  }

  window.RaymapScene = { Scene, Camera };
})();
