'use strict';
const at = id => document.getElementById(id);
const version = document.body.dataset.version;
const LATE = 35000;
let source, heard = Date.now(), isLost = null, announced = null;

// Times in the time zone of the browser.
function clock(time) {
  const then = new Date(time.dateTime), minutes = Math.floor((Date.now() - then) / 60000);
  if (isNaN(then)) return;
  const isToday = then.toDateString() === new Date().toDateString();
  const text = isToday ? then.toLocaleTimeString([], { timeStyle: 'short' })
    : then.toLocaleString([], { dateStyle: 'medium', timeStyle: 'short' });
  const ago = minutes < 0 || minutes >= 60 ? '' : minutes === 0 ? ' (now)' : ` (${minutes} min ago)`;
  if (time.textContent !== text + ago) time.textContent = text + ago;
  time.title = then.toLocaleString();
}
const clocks = root => root.querySelectorAll('time').forEach(clock);

// Changes an element into another one, and keeps what is the same: the focus, pictures, what is open.
function morph(old, fresh) {
  if (old.isEqualNode(fresh)) return;
  if (old.nodeName !== fresh.nodeName) return old.replaceWith(fresh);
  if (old.nodeType !== Node.ELEMENT_NODE) { old.data = fresh.data; return; }
  for (const { name } of [...old.attributes])
    if (!fresh.hasAttribute(name) && name !== 'open' && name !== 'hidden') old.removeAttribute(name);
  for (const { name, value } of [...fresh.attributes])
    if (old.getAttribute(name) !== value) old.setAttribute(name, value);
  children(old, fresh);
}
function children(old, fresh) {
  const named = new Map([...old.children].filter(child => child.id).map(child => [child.id, child]));
  let next = old.firstChild;
  for (const node of [...fresh.childNodes]) {
    const same = node.id ? named.get(node.id) : next && !next.id && next.nodeName === node.nodeName ? next : null;
    if (!same) { old.insertBefore(node, next); continue; }
    if (same === next) next = next.nextSibling; else old.insertBefore(same, next);
    morph(same, node);
  }
  while (next) { const rest = next.nextSibling; next.remove(); next = rest; }
}

// Reads aloud what is new.
function announce() {
  const now = new Map([...document.querySelectorAll('[data-news]')].map(each => [each.id + each.dataset.news, each.dataset.news]));
  if (announced) {
    const fresh = [...now].filter(([key]) => !announced.has(key)).map(([, text]) => text);
    if (fresh.length) at('live').textContent = fresh.slice(0, 3).join('. ');
  }
  announced = new Set(now.keys());
}

function lost(is) {
  if (is === isLost) return;
  isLost = is;
  document.body.className = is ? 'is-lost' : 'is-live';
  // The first event after this has the whole state.
  const state = document.querySelector('.state');
  if (is && state.dataset.news !== 'Stopped') {
    state.className = 'state bad';
    state.querySelector('.word').textContent = 'No connection';
    state.querySelector('.how').textContent = 'The state of the station is not known.';
  }
  at('link').textContent = is ? 'Not connected' : 'Live';
  at('lost').textContent = is ? 'No connection to the station since ' + new Date().toLocaleTimeString([], { timeStyle: 'short' }) +
    '. It was stopped, or the network is interrupted. What you see may be outdated.' : '';
}

function take(event) {
  const news = JSON.parse(event.data);
  if (news.version !== version) return location.reload();
  heard = Date.now();
  lost(false);
  if (document.title !== news.title) document.title = news.title;
  const home = document.activeElement.closest('[id^="p-"]');
  for (const [id, html] of Object.entries(news.pieces)) {
    const fresh = document.createElement('div');
    fresh.innerHTML = html;
    clocks(fresh);
    children(at('p-' + id), fresh);
  }
  // The focused button may have been removed.
  if (home && !home.contains(document.activeElement)) (home.querySelector('h2') || at('h-finished')).focus();
  announce();
}

function connect() {
  source?.close();
  source = new EventSource('/events');
  source.addEventListener('state', take);
  source.onerror = () => {
    lost(true);
    // The browser tries again itself, except after a refusal.
    if (source.readyState === EventSource.CLOSED) setTimeout(connect, 5000);
  };
}

document.addEventListener('submit', async event => {
  event.preventDefault();
  const form = event.target, button = form.querySelector('button');
  if (button.ariaDisabled === 'true') return;
  button.ariaDisabled = 'true';
  let text;
  try {
    const body = new URLSearchParams(new FormData(form));
    const answer = await fetch(form.getAttribute('action'), { method: 'POST', body, headers: { Accept: 'application/json' } });
    text = (await answer.json()).text;
  } catch {
    text = 'The station did not answer. Reload the page, and try again.';
  }
  at('done').textContent = text;
  button.ariaDisabled = null;
});
document.addEventListener('error', event => { if (event.target.nodeName === 'IMG') event.target.hidden = true; }, true);
setInterval(() => {
  clocks(document);
  if (Date.now() - heard > LATE) { heard = Date.now(); lost(true); connect(); }
}, 5000);
at('link').hidden = false;
at('link').textContent = 'Connecting';
clocks(document);
announce();
connect();
