// Fetches the whole site at the first visit, and answers from there afterwards: no network is needed any more. Another version is
// fetched whole beside this one, and takes its place once no page of this one is open.

// Filled in by `cairn page`.
const SITE = { version: '', files: [] };
const NAME = `cairn-${SITE.version}`;

addEventListener('install', (event) => {
  const fresh = SITE.files.map((file) => new Request(file, { cache: 'reload' }));
  event.waitUntil(caches.open(NAME).then((cache) => cache.addAll(fresh)));
});

addEventListener('activate', (event) => {
  const others = async () => Promise.all((await caches.keys()).filter((name) => name.startsWith('cairn-') && name !== NAME).map((name) => caches.delete(name)));
  event.waitUntil(others());
});

addEventListener('fetch', (event) => {
  const kept = async () => (await (await caches.open(NAME)).match(event.request, { ignoreSearch: true })) ?? fetch(event.request);
  event.respondWith(kept());
});
