// The 3-D view of the report: WebGL2, no library, no network. Lengths in mm of the part frame, +Z up.
(() => {
  'use strict';
  const $ = id => document.getElementById(id);
  const stage = $('stage'), canvas = $('view'), over = $('over'), still = $('still'), live = $('live');
  const gl = canvas.getContext('webgl2', { antialias: true, alpha: false });
  if (!gl) return;

  // ---- vectors ----
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const add = (a, b, s = 1) => [a[0] + b[0] * s, a[1] + b[1] * s, a[2] + b[2] * s];
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const unit = a => { const l = Math.hypot(...a) || 1; return a.map(v => v / l); };
  const turned = (v, axis, angle) => {
    const c = Math.cos(angle), s = Math.sin(angle), d = dot(v, axis) * (1 - c), x = cross(axis, v);
    return v.map((value, i) => value * c + x[i] * s + axis[i] * d);
  };
  const clamp = (v, low, high) => Math.min(high, Math.max(low, v));

  // ---- the file: glTF 2.0 binary, one buffer ----
  const scene = JSON.parse($('scene').textContent);
  const file = Uint8Array.from(atob($('mark-on-part').textContent.trim()), c => c.charCodeAt(0));
  const head = new DataView(file.buffer);
  const jsonLength = head.getUint32(12, true);
  const gltf = JSON.parse(new TextDecoder().decode(file.subarray(20, 20 + jsonLength)));
  const binary = 28 + jsonLength;
  const READ = {
    5120: [1, 'getInt8', 127], 5121: [1, 'getUint8', 255], 5122: [2, 'getInt16', 32767],
    5123: [2, 'getUint16', 65535], 5125: [4, 'getUint32', 1], 5126: [4, 'getFloat32', 1],
  };
  const numbers = index => {
    const accessor = gltf.accessors[index], view = gltf.bufferViews[accessor.bufferView];
    const width = { SCALAR: 1, VEC2: 2, VEC3: 3, VEC4: 4 }[accessor.type];
    const [size, get, most] = READ[accessor.componentType], step = view.byteStride || size * width;
    const start = binary + (view.byteOffset || 0) + (accessor.byteOffset || 0);
    const out = new Float64Array(accessor.count * width), share = accessor.normalized ? most : 1;
    for (let i = 0; i < accessor.count; i++)
      for (let k = 0; k < width; k++) out[i * width + k] = head[get](start + i * step + k * size, true) / share;
    return { out, width, count: accessor.count };
  };
  // glTF has metres and +Y up, the part frame mm and +Z up.
  const vectors = (index, scale) => {
    const { out, count } = numbers(index), to = new Float32Array(3 * count);
    for (let i = 0; i < 3 * count; i += 3) {
      to[i] = out[i] * scale; to[i + 1] = -out[i + 2] * scale; to[i + 2] = out[i + 1] * scale;
    }
    return to;
  };
  const primitives = name => {
    const node = gltf.nodes.find(node => node.name === name && node.mesh !== undefined);
    return node ? gltf.meshes[node.mesh].primitives : [];
  };
  const triangles = name => {
    const parts = primitives(name).filter(p => (p.mode ?? 4) === 4).map(({ attributes, indices }) => {
      const at = vectors(attributes.POSITION, 1000), count = at.length / 3;
      const normal = attributes.NORMAL === undefined ? null : vectors(attributes.NORMAL, 1);
      const order = indices === undefined ? Uint32Array.from({ length: count }, (_, i) => i)
        : Uint32Array.from(numbers(indices).out);
      return { at, normal, order };
    });
    const total = key => parts.reduce((sum, part) => sum + part[key].length, 0);
    const mesh = { at: new Float32Array(total('at')), normal: new Float32Array(total('at')), order: new Uint32Array(total('order')) };
    let vertex = 0, corner = 0;
    for (const { at, normal, order } of parts) {
      mesh.at.set(at, vertex);
      if (normal) mesh.normal.set(normal, vertex);
      order.forEach(i => { mesh.order[corner++] = i + vertex / 3; });
      vertex += at.length;
    }
    return mesh;
  };
  // Segments as [from, to, colour from, colour to] in bytes that the line program reads: 32 each.
  const SEGMENT = 32;
  const packed = segments => {
    const data = new DataView(new ArrayBuffer(segments.length * SEGMENT));
    segments.forEach(([a, b, ca, cb], i) => {
      for (let k = 0; k < 3; k++) {
        data.setFloat32(i * SEGMENT + 4 * k, a[k], true); data.setFloat32(i * SEGMENT + 12 + 4 * k, b[k], true);
      }
      for (let k = 0; k < 4; k++) {
        data.setUint8(i * SEGMENT + 24 + k, ca ? ca[k] : 0); data.setUint8(i * SEGMENT + 28 + k, cb ? cb[k] : 0);
      }
    });
    return data;
  };
  const lines = name => primitives(name).filter(p => p.mode === 1 || p.mode === 3).flatMap(primitive => {
    const { attributes, indices, mode } = primitive;
    const at = vectors(attributes.POSITION, 1000);
    const color = attributes.COLOR_0 === undefined ? null : numbers(attributes.COLOR_0);
    const order = indices === undefined ? Array.from({ length: at.length / 3 }, (_, i) => i) : Array.from(numbers(indices).out);
    // glTF has colours in linear light.
    const shown = v => Math.round(255 * (v <= 0.0031308 ? 12.92 * v : 1.055 * v ** (1 / 2.4) - 0.055));
    const bytes = i => color && [0, 1, 2].map(k => shown(color.out[i * color.width + k])).concat(255);
    const point = i => [at[3 * i], at[3 * i + 1], at[3 * i + 2]];
    const out = [];
    for (let i = 0; i + 1 < order.length; i += mode === 1 ? 2 : 1) {
      const [a, b] = [order[i], order[i + 1]];
      out.push([point(a), point(b), bytes(a), bytes(b)]);
    }
    return out;
  });
  const part = triangles('part'), ink = triangles('mark-ink');
  const mark = lines('mark'), drawn = lines('drawn'), seen = lines('view');

  const box = points => {
    const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
    for (const p of points) for (let k = 0; k < 3; k++) { low[k] = Math.min(low[k], p[k]); high[k] = Math.max(high[k], p[k]); }
    const center = low.map((v, k) => (v + high[k]) / 2);
    return low[0] <= high[0] ? { center, radius: Math.max(Math.hypot(...add(high, low, -1)) / 2, 0.01) } : null;
  };
  const each3 = function* (at) { for (let i = 0; i < at.length; i += 3) yield [at[i], at[i + 1], at[i + 2]]; };
  const markBox = box(mark.flatMap(s => [s[0], s[1]])) || box(each3(ink.at)) || box(drawn.flatMap(s => [s[0], s[1]]));
  const whole = box(each3(part.at)) || markBox || { center: [0, 0, 0], radius: 1 };
  const [right, up, out] = scene.view;
  // The arrow of the beam points at the mark from outside: some of its points are enough to find where that is.
  const aims = mark.filter((_, i) => i % Math.ceil(mark.length / 300) === 0).map(s => s[0]);
  if (!aims.length) aims.push(whole.center);
  // Lines that are close together are drawn thinner, so that they do not merge: their usual distance, mm.
  const spread = axis => { const v = aims.map(p => dot(axis, p)); return Math.max(...v) - Math.min(...v); };
  const length = mark.reduce((sum, [a, b]) => sum + Math.hypot(...add(b, a, -1)), 0);
  const gap = length ? spread(right) * spread(up) / length : Infinity;

  // Edges of the part: where the normals of two facets differ by more than 35 degrees, and open borders.
  const edges = () => {
    const found = new Map(), ids = new Map(), count = part.order.length;
    if (count > 300000) return [];
    const id = new Uint32Array(count), grid = 1e5 / whole.radius;
    const vector = (of, i) => { const v = 3 * part.order[i]; return [of[v], of[v + 1], of[v + 2]]; };
    const point = i => vector(part.at, i);
    for (let i = 0; i < count; i++) {
      const key = point(i).map(v => Math.round(v * grid)).join();
      if (!ids.has(key)) ids.set(key, ids.size);
      id[i] = ids.get(key);
    }
    for (let i = 0; i + 2 < count; i += 3) {
      const facet = cross(add(point(i + 1), point(i), -1), add(point(i + 2), point(i), -1));
      if (Math.hypot(...facet) < 1e-9 * whole.radius ** 2) continue;
      for (const [s, t] of [[i, i + 1], [i + 1, i + 2], [i + 2, i]]) {
        if (id[s] === id[t]) continue;
        const key = Math.min(id[s], id[t]) * ids.size + Math.max(id[s], id[t]), known = found.get(key);
        const smooth = add(vector(part.normal, s), vector(part.normal, t));
        const normal = unit(Math.hypot(...smooth) > 0.1 ? smooth : facet);
        if (known) known.turn = dot(known.normal, normal);
        else found.set(key, { normal, turn: -2, s, t });
      }
    }
    return [...found.values()].filter(edge => edge.turn < 0.82).map(edge => [point(edge.s), point(edge.t)]);
  };

  // ---- other things in the picture ----
  const outline = corners => corners.map((p, i) => [p, corners[(i + 1) % corners.length]]);
  const planes = (scene.focus || []).concat(scene.field ? [scene.field] : []);
  const reach = Math.max(whole.radius, ...planes.flat().map(p => Math.hypot(...add(p, whole.center, -1)))) * 1.05;

  // ---- programs ----
  const program = (vertex, fragment) => {
    const made = gl.createProgram();
    for (const [type, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(type);
      gl.shaderSource(shader, '#version 300 es\nprecision highp float;' + text);
      gl.compileShader(shader);
      gl.attachShader(made, shader);
    }
    gl.linkProgram(made);
    const uniform = {};
    for (const name of ['turn', 'center', 'size', 'depth', 'color', 'own', 'width', 'shade'])
      uniform[name] = gl.getUniformLocation(made, name);
    return { made, uniform };
  };
  const CAMERA = `
    uniform mat3 turn; uniform vec3 center; uniform vec3 size; uniform vec2 depth;
    vec3 place(vec3 p) { return turn * (p - center); }
    vec4 seen(vec2 px, float z) { return vec4(2.0 * px / size.xy, -z * depth.x - depth.y, 1.0); }`;
  let surface, line, things;
  const buffer = data => {
    const made = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, made);
    gl.bufferData(gl.ARRAY_BUFFER, data, gl.STATIC_DRAW);
  };
  const attribute = (at, size, type, stride, offset, each) => {
    gl.enableVertexAttribArray(at);
    gl.vertexAttribPointer(at, size, type, type === gl.UNSIGNED_BYTE, stride, offset);
    gl.vertexAttribDivisor(at, each);
  };
  const meshThing = mesh => {
    const array = gl.createVertexArray();
    gl.bindVertexArray(array);
    buffer(mesh.at); attribute(0, 3, gl.FLOAT, 0, 0, 0);
    buffer(mesh.normal); attribute(1, 3, gl.FLOAT, 0, 0, 0);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, mesh.order, gl.STATIC_DRAW);
    return { array, count: mesh.order.length };
  };
  const lineThing = segments => {
    const array = gl.createVertexArray();
    gl.bindVertexArray(array);
    buffer(packed(segments));
    attribute(0, 3, gl.FLOAT, SEGMENT, 0, 1); attribute(1, 3, gl.FLOAT, SEGMENT, 12, 1);
    attribute(2, 4, gl.UNSIGNED_BYTE, SEGMENT, 24, 1); attribute(3, 4, gl.UNSIGNED_BYTE, SEGMENT, 28, 1);
    return { array, count: segments.length };
  };
  const quad = corners => meshThing({
    at: new Float32Array(corners.flat()), normal: new Float32Array(12), order: new Uint32Array([0, 1, 2, 0, 2, 3]),
  });
  const build = () => {
    surface = program(`layout(location=0) in vec3 at; layout(location=1) in vec3 normal; out vec3 n; ${CAMERA}
      void main() { vec3 p = place(at); n = turn * normal; gl_Position = seen(p.xy * size.z, p.z); }`,
    `in vec3 n; uniform vec4 color; uniform float shade; out vec4 ink;
      void main() {
        vec3 m = length(n) > 0.0 ? normalize(n) : vec3(0, 0, 1);
        if (m.z < 0.0) m = -m;
        float light = 0.58 + 0.4 * max(dot(m, vec3(-0.42, 0.5, 0.757)), 0.0) + 0.1 * m.y;
        light *= mix(0.8, 1.0, smoothstep(0.0, 0.4, m.z));
        float gloss = 0.07 * pow(max(dot(m, vec3(-0.224, 0.267, 0.937)), 0.0), 24.0);
        ink = vec4(mix(color.rgb, color.rgb * light + gloss, shade), color.a);
      }`);
    line = program(`layout(location=0) in vec3 a; layout(location=1) in vec3 b;
      layout(location=2) in vec4 ca; layout(location=3) in vec4 cb;
      uniform float width, own; uniform vec4 color; out vec4 c; ${CAMERA}
      void main() {
        vec3 p = place(a), q = place(b);
        vec2 along = (q.xy - p.xy) * size.z;
        vec2 d = length(along) > 1e-4 ? normalize(along) : vec2(1, 0);
        bool end = gl_VertexID > 1;
        vec2 off = d * (end ? 0.5 : -0.5) + vec2(-d.y, d.x) * (gl_VertexID % 2 == 0 ? 0.5 : -0.5);
        vec3 m = end ? q : p;
        c = mix(color, end ? cb : ca, own);
        gl_Position = seen(m.xy * size.z + off * width, m.z);
      }`,
    'in vec4 c; out vec4 ink; void main() { ink = c; }');
    things = {
      part: meshThing(part), ink: meshThing(ink), edges: lineThing(edges()), mark: lineThing(mark),
      drawn: lineThing(drawn), seen: lineThing(seen),
      planes: planes.map(corners => ({ fill: quad(corners), rim: lineThing(outline(corners)) })),
    };
    gl.enable(gl.DEPTH_TEST);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
    gl.depthFunc(gl.LEQUAL);
  };

  // ---- camera: orthographic, so that the scale bar is true everywhere ----
  let camera, flight = null, chosen = null;
  const FROM_LASER = { axes: [right, up, out] };
  // At an angle: from above a side, and from below the drawing's lower edge on top or bottom, with the part upright.
  const angled = () => {
    const isFlat = Math.abs(out[2]) > 0.7, vertical = [0, 0, out[2] < -0.7 ? -1 : 1];
    const away = isFlat ? add(add(out, right, 0.3), up, -0.8) : add(add(out, cross(vertical, out), 0.45), vertical, 0.5);
    const o = unit(away), r = unit(cross(vertical, o));
    return [r, cross(o, r), o];
  };
  const VIEWS = {
    laser: FROM_LASER,
    angled: { axes: angled() },
    front: { axes: [[1, 0, 0], [0, 0, 1], [0, -1, 0]] },
    top: { axes: [[1, 0, 0], [0, 1, 0], [0, 0, 1]] },
  };
  const ratio = () => Math.min(2, window.devicePixelRatio || 1);
  const sizeOf = () => { const { width, height } = stage.getBoundingClientRect(); return [Math.max(1, width), Math.max(1, height)]; };
  // The visible height, mm, that shows a ball of this radius.
  const heightFor = radius => { const [w, h] = sizeOf(); return 2.16 * radius * Math.max(1, h / w); };
  // The box of the part as seen along these axes, so that long parts fill the picture.
  const fitted = (axes, points, margin) => {
    const low = [Infinity, Infinity], high = [-Infinity, -Infinity], [w, h] = sizeOf();
    for (const p of points) for (let k = 0; k < 2; k++) {
      const v = dot(axes[k], p);
      low[k] = Math.min(low[k], v); high[k] = Math.max(high[k], v);
    }
    if (low[0] > high[0]) return { center: whole.center, height: heightFor(whole.radius) };
    const middle = [(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, dot(axes[2], whole.center)];
    const center = axes.reduce((sum, axis, k) => add(sum, axis, middle[k]), [0, 0, 0]);
    return { center, height: Math.max(margin * Math.max(high[1] - low[1], (high[0] - low[0]) * h / w), whole.radius * 1e-3) };
  };
  const partPoints = () => part.at.length ? each3(part.at) : mark.flatMap(s => [s[0], s[1]]);
  const markPoints = () => mark.length ? mark.flatMap(s => [s[0], s[1]]) : partPoints();
  const wholeView = axes => ({ axes, ...fitted(axes, partPoints(), 1.2) });

  // ---- drawing ----
  const dark = window.matchMedia('(prefers-color-scheme: dark)');
  const LIGHT = { ground: [246, 247, 249], part: [201, 206, 214], edge: [30, 38, 50, 120], ink: [17, 24, 39, 255], before: [178, 84, 12, 255], text: '#1f2937', halo: 'rgba(255,255,255,.85)' };
  const DARK = { ground: [20, 25, 33], part: [150, 157, 168], edge: [8, 10, 14, 170], ink: [10, 12, 18, 255], before: [255, 176, 92, 255], text: '#e6eaf0', halo: 'rgba(15,20,27,.85)' };
  const TEAL = [15, 118, 110, 255], BLUE = [37, 99, 235, 255], GREY = [91, 100, 114, 255];
  const on = name => { const box = $('show-' + name); return !!box && box.checked; };
  const rgba = ([r, g, b, a = 255]) => [r / 255, g / 255, b / 255, a / 255];

  const draw = (width, height, colors, scale) => {
    const px = height / camera.height;
    gl.viewport(0, 0, width, height);
    gl.clearColor(...rgba(colors.ground));
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    const turn = [];
    for (let column = 0; column < 3; column++) for (let row = 0; row < 3; row++) turn.push(camera.axes[row][column]);
    const middle = dot(camera.axes[2], add(whole.center, camera.center, -1));
    const use = (program, lift, color) => {
      const { made, uniform } = program;
      gl.useProgram(made);
      gl.uniformMatrix3fv(uniform.turn, false, turn);
      gl.uniform3fv(uniform.center, add(camera.center, camera.axes[2], middle));
      gl.uniform3f(uniform.size, width, height, px);
      // Lines are lifted towards the eye, because the facets of the part lie beside its true surface.
      gl.uniform2f(uniform.depth, 0.99 / reach, lift * 0.99 * whole.radius / reach);
      gl.uniform4fv(uniform.color, rgba(color));
      return uniform;
    };
    const mesh = (thing, color, lift, shade) => {
      if (!thing.count) return;
      gl.uniform1f(use(surface, lift, color).shade, shade);
      gl.bindVertexArray(thing.array);
      gl.drawElements(gl.TRIANGLES, thing.count, gl.UNSIGNED_INT, 0);
    };
    const stroke = (thing, color, lift, thickness, own) => {
      if (!thing.count) return;
      const uniform = use(line, lift, color);
      gl.uniform1f(uniform.width, thickness * scale);
      gl.uniform1f(uniform.own, own ? 1 : 0);
      gl.bindVertexArray(thing.array);
      gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, thing.count);
    };
    const stretch = on('stretch'), thin = width => clamp(0.4 * gap * px / scale, 0.7, width);
    if (on('part')) {
      mesh(things.part, colors.part, 0, 1);
      stroke(things.edges, colors.edge, 0.004, 1);
      stroke(things.seen, GREY, 0.006, 1);
    }
    if (on('after') && !stretch) mesh(things.ink, colors.ink, 0.008, 0);
    if (on('before')) stroke(things.drawn, colors.before, 0.010, thin(1.6), stretch);
    if (on('after')) stroke(things.mark, colors.ink, 0.012, thin(stretch ? 2.4 : 1.8), stretch);
    gl.depthMask(false);
    things.planes.forEach(({ fill, rim }, i) => {
      const isField = i >= planes.length - (scene.field ? 1 : 0);
      if (!on(isField ? 'field' : 'focus')) return;
      const color = isField ? TEAL : BLUE;
      mesh(fill, [...color.slice(0, 3), 26], 0, 0);
      stroke(rim, color, 0, 1.6);
    });
    gl.depthMask(true);
  };

  const projected = (p, width, height) => {
    const d = add(p, camera.center, -1), px = height / camera.height;
    return [width / 2 + dot(camera.axes[0], d) * px, height / 2 - dot(camera.axes[1], d) * px];
  };

  // Axes, scale bar, labels and the marks of notices: on a second canvas, which the pointer does not meet.
  const annotate = (context, width, height, colors, size) => {
    const write = (text, x, y, color = colors.text, bold = '') => {
      context.font = `${bold} ${size}px system-ui, sans-serif`;
      context.lineWidth = size / 4;
      context.strokeStyle = colors.halo;
      context.lineJoin = 'round';
      context.strokeText(text, x, y);
      context.fillStyle = color;
      context.fillText(text, x, y);
    };
    context.textBaseline = 'middle';
    context.textAlign = 'center';
    const origin = [size * 4, height - size * 4], arm = size * 2.3;
    [[[1, 0, 0], 'x', '#d33c3c'], [[0, 1, 0], 'y', '#2f9e44'], [[0, 0, 1], 'z', '#3b73e0']]
      .map(([axis, name, color]) => ({ v: camera.axes.map(a => dot(a, axis)), name, color }))
      .sort((a, b) => a.v[2] - b.v[2])
      .forEach(({ v, name, color }) => {
        const end = [origin[0] + v[0] * arm, origin[1] - v[1] * arm];
        context.beginPath();
        context.moveTo(...origin);
        context.lineTo(...end);
        context.strokeStyle = color;
        context.lineWidth = size / 5;
        context.stroke();
        if (Math.hypot(v[0], v[1]) > 0.2) write(name, origin[0] + v[0] * arm * 1.32, origin[1] - v[1] * arm * 1.32, color, 'bold');
      });
    const px = height / camera.height, most = Math.min(width * 0.3, size * 12) / px;
    const ten = 10 ** Math.floor(Math.log10(most)), bar = [5, 2, 1].find(k => k * ten <= most) * ten;
    const x1 = width - size * 1.5, x0 = x1 - bar * px, y = height - size * 1.4;
    for (const [color, wide] of [[colors.halo, size / 2], [colors.text, size / 6]]) {
      context.beginPath();
      context.moveTo(x0, y - size / 2.5); context.lineTo(x0, y); context.lineTo(x1, y); context.lineTo(x1, y - size / 2.5);
      context.strokeStyle = color;
      context.lineWidth = wide;
      context.stroke();
    }
    write(`${+bar.toPrecision(2)} mm`, (x0 + x1) / 2, y - size * 0.95);
    // The beam: an arrow of constant size above the mark, pale where the part hides it.
    const v = camera.axes.map(axis => dot(axis, out)), slant = Math.hypot(v[0], v[1]);
    if (slant > 0.2) {
      const ahead = [v[0] / slant, -v[1] / slant], seen = aims.map(p => projected(p, width, height));
      const far = ([x, y]) => x * ahead[0] + y * ahead[1];
      const [x, y] = seen.reduce((a, b) => far(b) > far(a) ? b : a);
      const from = size * 0.7, to = from + size * (1.5 + 4 * slant), red = colors === DARK ? '#ff7b7b' : '#c3262c';
      const point = (far, aside = 0) => [x + ahead[0] * far - ahead[1] * aside, y + ahead[1] * far + ahead[0] * aside];
      context.globalAlpha = v[2] < -0.05 ? 0.3 : 1;
      context.strokeStyle = context.fillStyle = red;
      context.lineWidth = size / 5;
      context.beginPath();
      context.moveTo(...point(to)); context.lineTo(...point(from + size * 0.8));
      context.stroke();
      context.beginPath();
      context.moveTo(...point(from)); context.lineTo(...point(from + size, size * 0.36)); context.lineTo(...point(from + size, -size * 0.36));
      context.fill();
      const [lx, ly] = point(to + size * (0.9 + 1.4 * Math.abs(ahead[0])));
      write('laser', clamp(lx, size * 2, width - size * 2), clamp(ly, size, height - size), red, 'bold');
      context.globalAlpha = 1;
    }
    scene.spots.forEach(({ label, at }, index) => at.forEach(place => {
      if (!on('spots') && index !== chosen) return;
      const [x, y] = projected(place, width, height), r = size * (index === chosen ? 0.85 : 0.62);
      context.beginPath();
      context.arc(x, y, r, 0, 7);
      context.fillStyle = index === chosen ? '#c026d3' : 'rgba(134,25,143,.82)';
      context.fill();
      context.lineWidth = size / 8;
      context.strokeStyle = '#fff';
      context.stroke();
      context.font = `bold ${size * (index === chosen ? 0.95 : 0.72)}px system-ui, sans-serif`;
      context.fillStyle = '#fff';
      context.fillText(label, x, y + size * 0.04);
    }));
  };

  let asked = false;
  const paint = () => {
    asked = false;
    if (gl.isContextLost()) return;
    const [w, h] = sizeOf(), k = ratio(), colors = dark.matches ? DARK : LIGHT;
    for (const c of [canvas, over]) if (c.width !== Math.round(w * k) || c.height !== Math.round(h * k)) {
      c.width = Math.round(w * k); c.height = Math.round(h * k);
    }
    draw(canvas.width, canvas.height, colors, k);
    const context = over.getContext('2d');
    context.setTransform(k, 0, 0, k, 0, 0);
    context.clearRect(0, 0, w, h);
    annotate(context, w, h, colors, 12);
    canvas.dataset.frame = +(canvas.dataset.frame || 0) + 1;
    if (flight) fly();
  };
  const ask = () => { if (!asked) { asked = true; requestAnimationFrame(paint); } };
  // The picture for paper: the same view in light colours.
  const print = () => {
    if (gl.isContextLost()) return;
    [still.width, still.height] = [canvas.width, canvas.height] = [1500, 940];
    draw(1500, 940, LIGHT, 2);
    const context = still.getContext('2d');
    context.drawImage(canvas, 0, 0);
    annotate(context, 1500, 940, LIGHT, 22);
    ask();
  };

  const calm = window.matchMedia('(prefers-reduced-motion: reduce)');
  const turnedTo = (from, to, t) => {
    // The shortest rotation between two frames, by its axis and angle.
    const rows = [0, 1, 2], m = rows.map(i => rows.map(j => rows.reduce((s, k) => s + to[k][i] * from[k][j], 0)));
    const angle = Math.acos(clamp((m[0][0] + m[1][1] + m[2][2] - 1) / 2, -1, 1));
    let axis = [m[2][1] - m[1][2], m[0][2] - m[2][0], m[1][0] - m[0][1]];
    if (Math.hypot(...axis) < 1e-6) axis = angle < 1 ? [0, 0, 1] : from[1];
    axis = unit(axis);
    return from.map(v => turned(v, axis, angle * t));
  };
  const fly = () => {
    const t = clamp((performance.now() - flight.start) / 350, 0, 1), s = t * t * (3 - 2 * t), { from, to } = flight;
    camera = t === 1 ? to : {
      axes: turnedTo(from.axes, to.axes, s),
      center: from.center.map((v, i) => v + (to.center[i] - v) * s),
      height: from.height * (to.height / from.height) ** s,
    };
    if (t === 1) { flight = null; canvas.dataset.still = 'yes'; }
    ask();
  };
  const go = to => {
    canvas.dataset.still = 'no';
    flight = { from: camera, to, start: performance.now() - (calm.matches ? 1e4 : 0) };
    fly();
  };
  const say = text => { live.textContent = text; };

  // ---- moving ----
  const moved = () => { flight = null; canvas.dataset.still = 'yes'; ask(); };
  const orbit = (dx, dy) => {
    const spin = camera.axes[1][2] < -1e-9 ? dx : -dx;
    const axes = camera.axes.map(v => turned(v, [0, 0, 1], spin));
    const upright = axes[1][2] >= -1e-9;
    let next = axes.map(v => turned(v, axes[0], -dy));
    // A view that stands upright stops at the pole, where left and right would change places.
    if (upright && next[1][2] < 0) {
      const o = [0, 0, axes[2][2] < 0 ? -1 : 1], r = unit(cross(Math.abs(axes[0][2]) < 0.99 ? cross(o, axes[0]) : axes[1], o));
      next = [r, cross(o, r), o];
    }
    camera = { ...camera, axes: next };
    moved();
  };
  const pan = (dx, dy) => {
    const mm = camera.height / sizeOf()[1];
    camera = { ...camera, center: add(add(camera.center, camera.axes[0], -dx * mm), camera.axes[1], dy * mm) };
    moved();
  };
  const zoom = (factor, x, y) => {
    const [w, h] = sizeOf(), height = clamp(camera.height * factor, whole.radius * 1e-3, whole.radius * 40);
    const shift = (camera.height - height) / h;
    const center = add(add(camera.center, camera.axes[0], ((x ?? w / 2) - w / 2) * shift), camera.axes[1], (h / 2 - (y ?? h / 2)) * shift);
    camera = { ...camera, height, center };
    moved();
  };
  const pointers = new Map();
  const at = event => { const r = canvas.getBoundingClientRect(); return [event.clientX - r.left, event.clientY - r.top]; };
  canvas.addEventListener('pointerdown', event => {
    canvas.focus({ preventScroll: true });
    canvas.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, at(event));
    event.preventDefault();
  });
  canvas.addEventListener('pointermove', event => {
    const before = pointers.get(event.pointerId);
    if (!before) return;
    const now = at(event), [dx, dy] = [now[0] - before[0], now[1] - before[1]];
    const others = [...pointers].filter(([id]) => id !== event.pointerId).map(([, place]) => place);
    pointers.set(event.pointerId, now);
    if (others.length) {
      const [o] = others, far = (a, b) => Math.max(8, Math.hypot(a[0] - b[0], a[1] - b[1]));
      pan(dx / 2, dy / 2);
      zoom(far(before, o) / far(now, o), (now[0] + o[0]) / 2, (now[1] + o[1]) / 2);
    } else if (event.buttons & 6 || event.shiftKey || event.ctrlKey) pan(dx, dy);
    else orbit(dx * 0.008, dy * 0.008);
  });
  for (const end of ['pointerup', 'pointercancel', 'lostpointercapture'])
    canvas.addEventListener(end, event => pointers.delete(event.pointerId));
  canvas.addEventListener('contextmenu', event => event.preventDefault());
  canvas.addEventListener('wheel', event => {
    event.preventDefault();
    zoom(Math.exp(clamp(event.deltaY * (event.deltaMode ? 30 : 1), -300, 300) * 0.0016), ...at(event));
  }, { passive: false });
  const NAMES = { laser: 'From the laser', angled: 'At an angle', front: 'From the front', top: 'From above', mark: 'The mark', whole: 'The whole part' };
  const show = name => {
    chosen = null;
    if (name === 'mark') go({ axes: camera.axes, ...fitted(camera.axes, markPoints(), 1.3) });
    else if (name === 'whole') go(wholeView(camera.axes));
    else go(wholeView(VIEWS[name].axes));
    say(NAMES[name] + '.');
  };
  const KEYS = {
    ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1],
    l: 'laser', a: 'angled', f: 'front', t: 'top', m: 'mark', w: 'whole',
  };
  canvas.addEventListener('keydown', event => {
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    const key = event.key.length === 1 ? event.key.toLowerCase() : event.key, act = KEYS[key];
    if (Array.isArray(act) && event.shiftKey) pan(-act[0] * 40, -act[1] * 40);
    else if (Array.isArray(act)) orbit(act[0] * Math.PI / 18, act[1] * Math.PI / 18);
    else if (act) show(act);
    else if (key === '+' || key === '=') zoom(0.8);
    else if (key === '-') zoom(1.25);
    else return;
    event.preventDefault();
  });
  document.querySelectorAll('[data-view]').forEach(button => button.addEventListener('click', () => show(button.dataset.view)));
  document.querySelectorAll('[data-spot]').forEach(button => button.addEventListener('click', () => {
    chosen = +button.dataset.spot;
    const spot = scene.spots[chosen], near = box(spot.at);
    stage.scrollIntoView({ block: 'nearest', behavior: calm.matches ? 'auto' : 'smooth' });
    go({ axes: VIEWS.angled.axes, center: near.center, height: heightFor(Math.max(near.radius * 1.3, whole.radius * 0.22)) });
    say('The picture shows the place ' + spot.label + '.');
  }));
  const root = gltf.nodes.find(node => node.extras && node.extras.isomark);
  const limit = root ? +(100 * root.extras.isomark.stretch_scale).toPrecision(3) : 0;
  if (limit) { $('least').textContent = `−${limit} % too short`; $('most').textContent = `+${limit} % too long`; }
  const legend = () => { $('legend').hidden = !on('stretch'); };
  document.querySelectorAll('input[id^=show-]').forEach(input => input.addEventListener('change', () => { legend(); ask(); }));

  // ---- start ----
  document.documentElement.classList.add('has-3d');
  build();
  camera = wholeView(VIEWS.angled.axes);
  canvas.dataset.still = 'yes';
  legend();
  new ResizeObserver(ask).observe(stage);
  dark.addEventListener('change', ask);
  canvas.addEventListener('webglcontextlost', event => event.preventDefault());
  canvas.addEventListener('webglcontextrestored', () => { build(); ask(); });
  const table = $('what'), wasOpen = { now: false };
  window.addEventListener('beforeprint', () => { wasOpen.now = table.open; table.open = true; print(); });
  window.addEventListener('afterprint', () => { table.open = wasOpen.now; });
  window.matchMedia('print').addEventListener('change', event => { if (event.matches) print(); });
  print();
  // For programs that compare the picture with numbers: where a point of the part frame, mm, is on the canvas, CSS px.
  window.isomark = Object.freeze({ project: point => projected(point, ...sizeOf()) });
})();
