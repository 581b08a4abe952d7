# What Cairn says and shows to a walker, in Spanish. The comments on the ids are in en.ftl.
#
# "Usted", with the verb first. An interval is "a los 3 metros" or "en 3 metros".

## Distances

distance = { $unit ->
    [feet] { $distance ->
        [one] { $distance } pie
       *[other] { $distance } pies
    }
    [steps] { $distance ->
        [one] { $distance } paso
       *[other] { $distance } pasos
    }
   *[metres] { $distance ->
        [one] { $distance } metro
       *[other] { $distance } metros
    }
}

## Clauses of the guide

guide-turn = { $to ->
    [left] gire a la izquierda
    [right] gire a la derecha
    [slightly-left] gire ligeramente a la izquierda
    [slightly-right] gire ligeramente a la derecha
    [sharp-left] gire mucho a la izquierda
    [sharp-right] gire mucho a la derecha
   *[around] dé media vuelta
}
guide-turn-clock = gire { $hour ->
    [1] a la 1
   *[other] a las { $hour }
}
guide-turn-degrees = gire { $degrees } grados a la { $side ->
    [left] izquierda
   *[right] derecha
}
guide-bear = { $kind ->
    [back] gire un poco a la { $side ->
        [left] izquierda
       *[right] derecha
    }
   *[other] más a la { $side ->
        [left] izquierda
       *[right] derecha
    }
}
guide-stairs = { $way ->
    [up] suba la escalera
   *[down] baje la escalera
}
guide-turn-and-stairs = { $turn } y { $stairs }
guide-and-stairs = , y { $stairs }
guide-arrive = habrá llegado
guide-continue = continúe { distance }
guide-continue-unmeasured = continúe
guide-move-slowly = avance despacio { distance }
guide-move-slowly-unmeasured = avance despacio
guide-move-back = retroceda { distance }
guide-move-back-unmeasured = retroceda
guide-after = , luego, en { distance }, { $next }
guide-after-unmeasured = , y enseguida { $next }
guide-place = { $place ->
    [ahead] delante
    [behind] detrás de usted
    [front] delante de usted
    [left] a su izquierda
   *[right] a su derecha
}
guide-place-clock = { $hour ->
    [1] a la 1
   *[other] a las { $hour }
}

## Sentences of the guide

guide-sentence = { CAPITAL($clause) }.
guide-go = { CAPITAL($go) }, luego { $next }{ $after }.
guide-go-end = { CAPITAL($go) } hasta el final.
guide-start = La ruta mide { distance }.
guide-start-unmeasured = No puedo medir distancias.
guide-start-back = La cámara mira hacia atrás.
guide-start-backwards = Atención, va a ir hacia atrás. Vaya despacio y solo por suelo llano.
guide-join = Está en la ruta, { $distance ->
    [one] falta
   *[other] faltan
} { distance }.
guide-join-unmeasured = Está en la ruta. No puedo medir distancias.
guide-away = La ruta está a { distance }, { $place }. No conozco el suelo que hay en medio. Pida ayuda para llegar a ella.
guide-away-unmeasured = La ruta está { $place }. No conozco el suelo que hay en medio. Pida ayuda para llegar a ella.
guide-note = { CAPITAL($text) }.
guide-note-at = { CAPITAL($text) } { $place ->
    [left] a su izquierda
    [right] a su derecha
    [ahead] delante
   *[behind] detrás de usted
}.
guide-found = Ya sé dónde estamos.
guide-clear = El camino está libre.
guide-around = Hay sitio al lado. Más despacio. { CAPITAL($turn) }.
guide-around-ahead = Hay sitio delante. Avance despacio.
guide-obstacle = { $what ->
    [overhead] Algo cuelga en el camino
   *[standing] Hay algo en el camino
}, a { $near ->
    [near] medio metro
   *[far] { distance }
} { $place ->
    [ahead] delante
    [ahead-left] delante, un poco a su izquierda
    [ahead-right] delante, un poco a su derecha
    [left] a su izquierda
   *[right] a su derecha
}.
guide-correction = Corrección.
guide-stop = Alto.
guide-stop-turning = Deje de girar.
guide-stand-still = Alto. Quédese quieto.
guide-approach = En { distance }, { $next }{ $after }.
guide-approach-unmeasured = Pronto, { $next }{ $after }.
guide-approach-end = Más despacio, { distance } hasta el final.
guide-approach-end-unmeasured = Más despacio, el final está cerca.
guide-turn-now = { CAPITAL($turn) } ahora{ $stairs }.
guide-turn-now-back = Alto. { CAPITAL($turn) }{ $stairs }.
guide-stairs-now = Escalera ahora, { $stairs }.
guide-progress = { $distance ->
    [one] Queda
   *[other] Quedan
} { distance }, luego { $next }.
guide-progress-unmeasured = Sigue en la ruta, luego { $next }.
guide-progress-end = { $distance ->
    [one] Queda
   *[other] Quedan
} { distance } hasta el final.
guide-progress-end-unmeasured = Sigue en la ruta hasta el final.
guide-off-path = Fuera de la ruta. { CAPITAL($turn) }, está a { distance }.
guide-off-path-unmeasured = Fuera de la ruta. { CAPITAL($turn) }.
guide-off-path-place = Fuera de la ruta. Está a { distance }, { $place }.
guide-off-path-place-unmeasured = Fuera de la ruta. Está { $place }.
guide-wrong-way = Dirección equivocada. { CAPITAL($turn) }.
guide-on-path = Está en la ruta.
guide-check-behind = Tantee detrás de usted con el bastón.
guide-step-aside = Alto. Dé un paso atrás y a la { $side ->
    [left] izquierda
   *[right] derecha
}.
guide-small-step = Dé un paso pequeño a la { $side ->
    [left] izquierda
   *[right] derecha
}.
guide-slow-down = Más despacio.
guide-weak = Más despacio. No veo bien.
guide-end-missed = Alto. { CAPITAL($turn) }, el final está a { distance }.
guide-end-missed-unmeasured = Alto. { CAPITAL($turn) }, el final está cerca.
guide-arrived = Alto. Ha llegado. Termina la guía.
guide-look-round = Déjeme ver dónde estamos. { CAPITAL($turn) }.

## Why the walker must stop

stop-tracking-lost = No sé dónde estamos.
stop-no-picture = No llega imagen de la cámara.
stop-pictures-late = Las imágenes llegan demasiado tarde.
stop-age-unknown = No sé de cuándo son las imágenes.
stop-obstacle = Hay algo en el camino.
stop-overhead = Algo cuelga en el camino.
stop-drop = El suelo baja de golpe delante.
stop-unknown-ground = No veo el suelo de delante.
stop-no-way-past = No encuentro por dónde pasar.
stop-scale = Aquí no puedo calcular distancias.{ $camera ->
    [ahead] {" "}Ayuda volverse e ir hacia atrás, o que la cámara mire hacia atrás.
   *[back] {""}
}
stop-relocalise = Aquí pierdo el lugar una y otra vez y no puedo seguir guiándole. Pida ayuda para avanzar unos metros.{ $camera ->
    [ahead] {" "}También ayuda ir hacia atrás, o que la cámara mire hacia atrás.
   *[back] {""}
}
stop-to-and-fro = Aquí le llevo de un lado a otro y no puedo seguir guiándole. Pida ayuda para avanzar unos metros.{ $camera ->
    [ahead] {" "}También ayuda ir hacia atrás, o que la cámara mire hacia atrás.
   *[back] {""}
}
stop-stage-died = Una parte de la guía ha dejado de funcionar.

## Before leaving: will the route be recognised?

ready-none = Todavía no hay ninguna ruta.
ready-all = Debería reconocer toda la ruta.
ready-hard = Me costará reconocer cerca de { distance } de esta ruta.
ready-hard-unmeasured = Me costará reconocer una parte de esta ruta.
ready-hard-all = Me costará reconocer esta ruta.
ready-unseen = No he visto en este sentido cerca de { distance } de esta ruta. Si ahí no sé dónde estamos, le pediré que se detenga.
ready-unseen-unmeasured = No he visto en este sentido una parte de esta ruta. Si ahí no sé dónde estamos, le pediré que se detenga.
ready-unseen-all = No he visto esta ruta en este sentido. Si no sé dónde estamos, le pediré que se detenga.
ready-camera-back = Con la cámara mirando hacia atrás debería reconocerla.

## Answers and news of a walk

walk-recording = Grabando.
walk-recording-unmeasured = Grabando. Todavía no puedo medir distancias.
walk-recording-in-memory = Grabo solo en la memoria: la ruta dura hasta que me apague, porque no se puede escribir { $file }: { $why }.
walk-already-recording = Ya estoy grabando.
walk-not-recording = No estoy grabando.
walk-recorded = Fin de la grabación, { distance }.
walk-recorded-unmeasured = Fin de la grabación.
walk-nothing-recorded = Fin de la grabación. No se ha grabado nada.
walk-file-incomplete = Fin de la grabación, pero su archivo no está entero. La ruta dura hasta que me apague. El ordenador dice: { $why }.
walk-no-route = Todavía no hay ninguna ruta. Grabe o cargue una primero.
walk-no-saved-route = No hay ninguna ruta grabada que cargar.
walk-routes-none = No hay ninguna ruta grabada.
walk-routes = { $count ->
    [one] Una ruta.
   *[other] { $count } rutas.
}
walk-routes-older = { $count ->
    [one] Y una ruta más antigua.
   *[other] Y { $count } rutas más antiguas.
}
walk-route-number = Ruta { $number }
walk-route-named = Ruta { $number }, { $name }
walk-when = { $days ->
    [0] de hoy
    [1] de ayer
   *[other] de hace { $days } días
}
walk-when-weeks = de hace { $weeks } semanas
walk-when-months = de hace { $months } meses
walk-when-years = de hace { $years } años
walk-with-notes = { $count ->
    [one] con una nota
   *[other] con { $count } notas
}
walk-route-lens-unknown = grabada antes de que yo conociera este teléfono
walk-route-loaded = { $route }. Cargada.
walk-route-loaded-elsewhere = { $route }. Cargada, pero no puedo guiarle por ella: { $why }.
walk-why-other-map = se grabó con otra cámara o en otro mapa
walk-why-guessed = yo aún no conocía este teléfono cuando se grabó. Grábela otra vez
walk-why-damaged = su archivo está dañado
walk-unknown-route = No hay ninguna ruta { $number }.
walk-no-route-at-hand = No hay ninguna ruta cargada. Cargue antes una.
walk-renamed = Nuevo nombre: { $route }.
walk-name-empty = El nombre está vacío.
walk-name-long = El nombre es demasiado largo.
walk-name-unsayable = El nombre tiene signos que no se pueden decir.
walk-rename-failed = No se puede dar nombre a la ruta: { $why }.
walk-ask-delete = ¿Borro esta ruta? { $route }. Responda sí o no.
walk-deleted = { $route }: borrada.
walk-delete-failed = No se puede borrar la ruta: { $why }.
walk-nothing-deleted = No se ha borrado nada.
walk-no-question = No hay ninguna pregunta que responder.
walk-being-recorded = Esa ruta se está grabando. Termine antes la grabación.
walk-stop-first = Estoy grabando. Termine antes la grabación.
walk-halt-first = La guía está en marcha. Deténgala antes.
walk-note-no-recording = Las notas son de una ruta. Empiece antes a grabar.
walk-note-no-place = No sé dónde estamos. Repita la nota dentro de un momento.
walk-note-too-many = Esta ruta tiene demasiadas notas.
walk-note-too-long = Esa nota es demasiado larga.
walk-marked = Lugar marcado. Escriba qué hay aquí.
walk-noted = Anotado: { $text }.
walk-noted-side = Anotado: { $text } a la { $side ->
    [left] izquierda
   *[right] derecha
}.
walk-landmark = punto de referencia
walk-searching = Todavía no reconozco este lugar. Gire despacio sobre sí, o acérquese a la ruta.
walk-map-not-saved = No se puede guardar el mapa: { $why }. Las rutas de hoy sirven hasta que me apague.
walk-map-saved = El mapa vuelve a guardarse.
walk-library-full = Grabo solo en la memoria, porque no caben más rutas. Borre antes algunas.
walk-route-unreadable = No se puede leer la ruta: { $why }.
walk-route-empty = Esa ruta está vacía.
walk-other-map = Esa ruta se grabó con otra cámara o en otro mapa. Aquí no puedo guiarle por ella.
walk-way-here-unknown = Todavía no sé dónde está usted.
walk-way-unknown = No conozco ningún lugar llamado { $place }. { walk-way-places }
walk-way-places = { $count ->
    [0] No conozco ningún lugar al que llevarle: no hay ninguna ruta grabada en este mapa.
   *[other] Puedo llevarle a estos lugares: { $places }.
}
walk-way-place = { $end ->
    [start] el principio de { $route }
   *[end] el final de { $route }
}
walk-way-route = la ruta { $number }
walk-way-going = Destino: { $place }, { distance }.
walk-way-going-unmeasured = Destino: { $place }.
walk-way-ambiguous = Conozco más de un lugar llamado { $place }.
walk-way-other-map = No conozco el camino a { $place }: ninguna ruta grabada lo une aún a este mapa.
walk-way-far = Está demasiado lejos de las rutas grabadas para ir a { $place }.
walk-way-not-joined = No conozco el camino a { $place }: ninguna ruta grabada lleva allí desde aquí.
walk-way-there = Ya está allí.
walk-route-too-short = No puedo guiarle: la ruta es demasiado corta.
walk-stairs-backwards = No puedo guiarle: la ruta tiene escaleras, que no son para ir hacia atrás.
walk-route-guessed = No puedo guiarle: cuando se grabó esta ruta, yo aún no conocía bien este teléfono. Grabe esta ruta otra vez.
walk-route-damaged = No puedo guiarle: la ruta está dañada.
walk-guidance-begins = Empieza la guía.
walk-guidance-ended = Fin de la guía.
walk-paused = La guía está en pausa.
walk-resumed = La guía continúa.
walk-not-paused = La guía no está en pausa.
walk-not-guiding = La guía no está en marcha.
walk-goodbye = Adiós.
walk-nothing-to-repeat = Todavía no he dicho nada.
walk-in-memory = en la memoria
walk-set = Hecho.
walk-picture-back = Vuelve a haber imagen.
walk-no-picture = No llega imagen de la cámara. No se mueva.
walk-mapping-failed = Alto. El mapa ha fallado. Termine la grabación y empiece de nuevo.
walk-tracking-failed = Un error del programa ha detenido el seguimiento.
walk-tracking-restarts = El seguimiento se reinicia. No se mueva.
walk-distances-known = Ya puedo medir distancias.
walk-distances-lost = Alto. He perdido las distancias, y la guía termina. Pida ayuda a alguien, o vuelva por donde ha venido.
walk-learn = Déjeme conocer este teléfono. Muévase durante medio minuto y gire una vez a la izquierda y otra a la derecha. Le avisaré cuando esté listo.
walk-learn-move = Avance antes unos metros. Le avisaré cuando esté listo.
walk-learn-again = Las distancias de esta ruta no son correctas: ahora conozco mejor este teléfono. Grabe esta ruta otra vez. Le avisaré cuando esté listo.
walk-learn-no-motion = No puedo conocer este teléfono sin sus sensores de movimiento. Permítalos en el navegador y vuelva a cargar la página.
walk-learning = Estoy conociendo este teléfono. Muévase y gire a la izquierda y a la derecha.
walk-ready = Estoy listo. Ya puede grabar una ruta.
walk-imu-failed = Los sensores de movimiento no responden. Sigo por la imagen.
walk-imu-back = Los sensores de movimiento vuelven a responder.
walk-disk-full = El disco está lleno. La ruta sigue en la memoria.
walk-disk-again = La ruta vuelve a estar en el disco.
walk-lost = No sé dónde estamos. No se mueva, o vuelva un poco atrás. La grabación está en pausa.
walk-age = La imagen es de hace { $seconds } segundos.
walk-age-too-old = La imagen es de hace { $seconds } segundos, demasiado antigua para guiar.
walk-age-unknown = No sé de cuándo es la imagen.
walk-length-so-far = Grabado hasta ahora: { distance }.
walk-to-go = { $distance ->
    [one] Falta
   *[other] Faltan
} { distance }.
walk-percent-done = { $percent } por ciento recorrido.
walk-guiding = Guiando, { page-guide-state }.

## The state of tracking

phase-loading = Preparando.
phase-first-image = Esperando la primera imagen de la cámara.
phase-no-image = No llega imagen de la cámara.
phase-no-imu = El sensor de movimiento no responde.
phase-points = Empezando. Mueva la cámara hacia un lado.
phase-unmeasured-move = Veo bien, pero no a qué distancia está todo. Mueva la cámara adelante y atrás, y arriba y abajo.
phase-unmeasured = Veo bien, pero todavía no puedo medir distancias.
phase-tracking = Veo bien.
phase-coasting = No veo bien, y sigo con los otros sensores.
phase-rotation = Solo puedo seguir los giros de la cámara. Avance para que sepa dónde estamos.
phase-lost = No sé dónde estamos.
phase-new-map = No sabía dónde estábamos y he empezado un mapa nuevo. El anterior se conserva.
phase-error = Algo va mal.
phase-error-why = Algo va mal: { $why }.

## What is waited for

wait-points = más cosas a la vista, para empezar un mapa
wait-parallax = movimiento lateral de la cámara
wait-imu = una lectura del sensor de movimiento
wait-first-try = más recorrido, para medir distancias
wait-time = más tiempo, para medir distancias
wait-excitation = un movimiento más vivo, para medir distancias
wait-baseline = un recorrido más largo, para medir distancias
wait-precision = una medida mejor de las distancias
wait-matches = algo que ya se haya visto
wait-translation = un paso a un lado o adelante
wait-place = un lugar que conozca

## Keys and commands

key-record = grabar
key-stop = terminar la grabación
key-note = anotar un punto de referencia
key-routes = decir las rutas
key-delete = borrar la ruta cargada
key-yes = sí
key-no = no
key-load = cargar la última ruta
key-guide = guiar de vuelta
key-take-me = decir adónde se me puede llevar
key-backwards = guiar hacia atrás
key-pause = pausar la guía
key-resume = continuar la guía
key-halt = terminar la guía
key-repeat = repetir
key-status = decir dónde estoy
key-quit = salir
key-lines = por líneas también: { $lines }

## The page: its parts

page-skip = Ir a las acciones
page-now = Ahora
page-words = Lo que he dicho
page-commands = Acciones
page-state = Estado
page-pictures = Imágenes
page-settings = Ajustes
page-log = Todo lo que se ha dicho
page-nothing-said = Todavía no se ha dicho nada.

## The page: commands

page-take = Tomar el control
page-take-over = Hacerse cargo
page-start-camera = Encender la cámara
page-record = Grabar
page-stop = Terminar la grabación
page-guide-home = Guiar de vuelta
page-guide-back = Guiar de vuelta, cámara hacia atrás
page-guide-backwards = Guiar hacia atrás
page-pause = Pausar
page-resume = Continuar
page-halt = Terminar la guía
page-load = Cargar la última ruta
page-guide-again = Guiar de principio a fin
page-take-me = ¿Adónde puede llevarme?
page-routes = Rutas
page-routes-none = Todavía no se ha grabado ninguna ruta.
page-routes-count = { $count ->
    [one] { $count } ruta
   *[other] { $count } rutas
}
page-route-loaded = Esta ruta está cargada.
page-load-one = Cargar
page-take-me-start = Llevarme al principio
page-take-me-end = Llevarme al final
page-rename = Cambiar el nombre
page-delete = Borrar
page-labelled = { $action }: { $route }
page-notes-count = { $count ->
    [one] { $count } nota.
   *[other] { $count } notas.
}
page-why-not = No puedo guiarle por ella: { $why }.
page-wait-picture = Esperar la imagen
page-note = Anotar un punto de referencia
page-anew = Grabar una ruta nueva
page-all-commands = Todas las acciones
page-say-routes = Decir las rutas
page-note-title = ¿Qué hay aquí?
page-note-text = Unas palabras, como puerta o fuente
page-note-where = ¿Dónde está?
page-note-left = a la izquierda
page-note-right = a la derecha
page-note-here = aquí mismo
page-note-voice = Grabar su voz
page-note-voice-end = Terminar la grabación de su voz
page-note-voice-again = Grabar su voz otra vez
page-note-voice-name = Nota de voz { $number }
page-note-voice-refused = No puedo usar el micrófono. Permítalo para esta página en los ajustes del navegador, o escriba la nota.
page-note-voice-lost = Su voz no se puede guardar en este navegador. La nota solo tiene su número.
page-note-save = Guardar la nota
page-name-text = Su nombre, como a la cocina
page-name-save = Guardar el nombre
page-delete-title = ¿Borrar la ruta?
page-delete-no = No, conservarla
page-delete-yes = Sí, borrarla
page-map-not-saved = { $map }; sin guardar: { $why }
page-repeat = Repetir
page-status = ¿Dónde estoy?
page-camera-refused = No puedo usar la cámara. Permítala para esta página en los ajustes del navegador y pulse Encender la cámara.
page-camera-missing = No encuentro ninguna cámara en este dispositivo. Abra la página en un teléfono.
page-camera-busy = Otro programa está usando la cámara. Ciérrelo y pulse Encender la cámara.
page-camera-failed = La cámara no se enciende. Vuelva a cargar la página y pulse Encender la cámara.
page-camera-ended = Una llamada u otro programa se ha quedado con la cámara. Pulse Encender la cámara.
page-camera-off = La cámara está apagada. Pulse Encender la cámara.
page-terminal-only = Eso solo se puede hacer en la terminal.
page-no-picture-yet = Espero la primera imagen.
page-missing-key = Este teléfono aún no está enlazado.
page-walk-failed = No puedo seguir. El ordenador muestra por qué.
page-walk-ended = La sesión ha terminado.

## The page: what to mind, in five sentences for the ear

page-before-title = Antes de empezar
page-before-aid = Soy una ayuda junto a su bastón o su perro, no en su lugar.
page-before-streets = No sirvo para calles con tráfico.
page-before-obstacles = Sin cámara de profundidad no veo obstáculos ni escalones, y aquí un teléfono no la tiene.
page-before-untried = Las personas ciegas todavía no me han probado con teléfonos reales.
page-before-pictures = Sus imágenes se quedan aquí, en sus propios dispositivos.
page-before-say = Repetir
page-before-heard = Lo he oído

## The page: the first start, practice, battery and light

page-reader-ask = ¿Usa un lector de pantalla?
page-reader-yes = Sí, me lee él
page-reader-no = No, hábleme
page-practice = Practicar con diez metros
page-practice-again = Repetir este paso
page-practice-end = Terminar la práctica
page-practice-camera = Práctica, primer paso. Busque, bajo techo, un camino libre de diez metros. Pulse Encender la cámara y muévase hasta que yo esté listo.
page-practice-record = Segundo paso. Póngase al principio de sus diez metros. Pulse Grabar.
page-practice-out = Tercer paso. Avance recto, con calma. Le avisaré a los diez metros.
page-practice-stop = Diez metros. Deténgase y pulse Terminar la grabación.
page-practice-home = Cuarto paso. Pulse Guiar de vuelta y siga lo que le diga. Con Pausar me callo, con Dónde estoy le digo dónde está.
page-practice-done = La práctica ha terminado. La ruta de práctica está en su lista, donde puede borrarla.
page-battery = La batería está al { $percent } por ciento.
page-dark-now = Está demasiado oscuro para la cámara. Encienda una luz o destape la cámara.
page-light-now = Ya hay luz suficiente.

## The page: a phone that the computer does not know

page-pair-title = Enlazar este teléfono
page-pair-code = El código para el teléfono: { $digits }.
page-pair-said = El ordenador dice ahora seis cifras, y las muestra. Escríbalas aquí.
page-pair-wait = Demasiados códigos equivocados. Espere { $seconds } segundos y pulse Repetir el código.
page-pair-wrong = Ese no es el código. Escuche otra vez y escriba las seis cifras.
page-pair-over = Ese no es el código, y ya no vale. Pulse Repetir el código dentro de medio minuto.
page-pair-offline = El ordenador no responde. Compruebe que el teléfono y el ordenador están en la misma red y pulse Repetir el código.
page-pair-digits = Las seis cifras
page-pair-done = Enlazar
page-pair-again = Repetir el código
page-known-title = ¿Nos conocemos?
page-known = ¿Es este el teléfono de la ruta { $number }?
page-known-named = ¿Es este el teléfono de la ruta { $number }, { $name }?
page-known-yes = Sí, es este
page-known-no = No, es otro

## The page: who holds the walk

page-controls = Usted tiene el control.
page-controls-now = Ahora usted tiene el control.
page-free-camera = Listo. Encienda la cámara para empezar.
page-free = Listo. La primera acción toma el control.
page-away = El dispositivo que tiene el control no está. Lo espero.
page-watching = Otro dispositivo tiene el control. Usted mira.
page-other-holds = Otro dispositivo tiene el control.
page-taken-over = Alto. Otro dispositivo ha tomado el control.
page-ask-title = ¿Tomar el control?
page-ask = Otro dispositivo tiene el control. Si usted lo toma, ese dispositivo deja de guiar y su cámara ya no se usa.
page-leave = Dejarlo
page-over = Hacerse cargo

## The page: connection and age of the picture

page-connecting = Conectando.
page-connected = Conectado.
page-connected-to = Conectado; la cámara es { $camera }.
page-not-connected-yet = Todavía sin conexión.
page-trying-again = Sin conexión. Intentándolo otra vez.
page-connected-again = Conectado otra vez.
page-connection-lost = Se ha perdido la conexión.
page-connection-lost-retry = Se ha perdido la conexión. Intentándolo otra vez.
page-connection-lost-stop = Alto. Se ha perdido la conexión.
page-no-answer = El ordenador no responde.
page-no-answer-stop = Alto. El ordenador no responde.
page-pictures-late = Alto. Las imágenes llegan demasiado tarde.
page-age = Imagen de hace { $seconds } s
page-age-about = Imagen de hace unos { $seconds } s
page-age-unknown = No sé de cuándo es la imagen.

## The page: the table of the state

page-tracking-label = Seguimiento
page-phase-label = Fase
page-imu-label = Sensor de movimiento
page-recording-label = Grabación
page-route-label = Ruta
page-guidance-label = Guía
page-scale-label = Escala
page-map-label = Mapa
page-time-label = Tiempo
page-not-started = no ha empezado
page-unknown-offline = sin conexión no se sabe
page-waits = { $phase }, espera { $waits }
page-not-used = no se usa
page-imu = funciona
page-recorded = { $length } metros, { $file }
page-recorded-units = longitud desconocida, { $file }
page-not-on-disk = { $recorded }; no está en el disco: { $why }
page-no = no
page-none = ninguna
page-route = { $file }
page-route-elsewhere = { page-route }, de otro mapa
page-guiding = { $facing ->
    [home] de frente
    [back] cámara hacia atrás
   *[backwards] hacia atrás
}, { page-guide-state }, { $along } de { $length }
page-guide-state = { $state ->
    [turning] girando
    [moving] avanzando
    [checking] tanteando detrás
    [stepping] apartándose
    [stopped] parado
    [paused] en pausa
    [arrived] en el destino
   *[waiting] esperando
}
page-guiding-metres = { page-guiding } metros
page-metres = metros
page-no-scale = desconocida, por eso no se dicen distancias
page-map-size = { $places ->
    [one] { $places } fotograma clave
   *[other] { $places } fotogramas clave
}, { $points ->
    [one] { $points } punto de referencia
   *[other] { $points } puntos de referencia
}
page-map-empty = vacío
page-time = { $clock }

## The page: pictures

page-own-label = Lo que ve esta cámara
page-own-caption = Esta cámara.
page-picture-label = Lo que ve la cámara que guía, con puntos sobre lo que reconozco
page-picture-caption = Lo que ve la cámara que guía; los puntos son lo que reconozco.
page-map-title = Mapa y ruta
page-map-how = Cómo mover el mapa
page-map-help = Las flechas giran la vista, con Mayúsculas la mueven; con W, A, S y D se avanza, con Q y E se baja y se sube, más y menos cambian el tamaño, 0 lo muestra todo.
page-map-follow = Seguir a la cámara
page-map-colour = Colores
page-map-height = por altura
page-map-age = por edad
page-map-normal = por dirección
page-map-low = bajo
page-map-high = alto
page-map-old = antiguo
page-map-new = nuevo
page-map-down = mira hacia abajo
page-map-up = mira hacia arriba
page-map-surface-show = Mostrar la superficie
page-map-points-show = Mostrar los puntos
page-map-columns-show = Mostrar el espacio libre y el ocupado
page-map-path = camino de la cámara
page-map-recorded = ruta grabada
page-map-plan = ruta corregida
page-map-loops = lugares vistos de nuevo
page-map-eye = cámara
page-map-bar = { $length } m
page-map-bar-units = { $length }
page-map-grid = Un cuadrado de la cuadrícula mide { $length } m de ancho.
page-map-grid-units = Un cuadrado de la cuadrícula mide { $length } unidades de longitud desconocida.
page-no-map = Todavía no hay mapa.
page-map-words = Un mapa de { $places ->
    [one] { $places } lugar
   *[other] { $places } lugares
} y { $points ->
    [one] { $points } punto
   *[other] { $points } puntos
}.
page-map-surface = La superficie mide unos { $area ->
    [one] { $area } metro cuadrado
   *[other] { $area } metros cuadrados
}.
page-map-route = La ruta grabada mide { $metres ->
    [one] { $metres } metro
   *[other] { $metres } metros
}.
page-map-walker = Ha recorrido el { $percent } por ciento de la ruta.

## The page: settings

page-language = Idioma
page-told = Cómo se dan las indicaciones
page-told-voice = con la voz de esta página
page-told-reader = con mi lector de pantalla
page-told-silent = solo con texto y vibración
page-unit = Distancias en
page-unit-metres = metros
page-unit-feet = pies
page-unit-steps = pasos
page-step = Longitud de un paso en centímetros
page-directions = Direcciones
page-directions-words = izquierda y derecha
page-directions-clock = como un reloj, «a las 2»
page-directions-degrees = en grados
page-speed = Palabras por minuto
page-volume = Volumen
page-sounds = Sonidos breves con las palabras
page-media = Botones de los auriculares y de la pantalla de bloqueo: reproducir repite, parar termina la guía
page-vibration = Vibración
page-keys = Las teclas sueltas sirven de atajos: { $keys }
page-dark = Oscurecer la pantalla
page-dark-title = La pantalla está oscura para ahorrar batería. La guía continúa.
page-light = Encender la pantalla

## The page: the engine in this device

page-here = Todo se calcula en este dispositivo; ninguna imagen sale de él.
page-here-stored = Todo está guardado aquí: ya no hace falta ninguna red.
page-here-failed = Ha fallado la guía.
page-here-failed-stop = Alto. Ha fallado la guía y empieza de nuevo.
page-here-too-old = No puedo funcionar en este navegador. Actualice el navegador o use Cairn con un ordenador.
page-here-twice = Cairn está abierto en otra pestaña de este navegador. Ciérrela y abra esta página otra vez.
page-here-turned = La imagen tiene ahora otra forma. Sostenga el teléfono como antes.
page-here-not-kept = Lo grabado no se puede guardar en este navegador. Haga sitio y no use una ventana privada.
page-demo = Ver una demostración: se guía a una persona simulada
page-demo-leave = Salir de la demostración
page-demo-start = Empezar la demostración
page-demo-off = En esta demostración una persona simulada sale y vuelve solo con estas palabras. Pulse Empezar la demostración.
page-demo-failed = La demostración no empieza. Necesita la red una vez; cargue la página de nuevo.
page-demo-ended = La demostración ha terminado. La persona simulada está a { $metres } metros del inicio.
page-files = Rutas como archivos
page-files-why = Las rutas y los mapas están solo en este navegador. Como archivos se pueden guardar en otro lugar, abrir en un ordenador y volver a cargar.
page-export = Guardar rutas y mapas como archivo
page-exported = Las rutas y los mapas están guardados como { $file }.
page-import = Cargar rutas y mapas
page-import-replaces = Los archivos sustituyen todas las rutas y mapas que hay aquí, y el recorrido empieza de nuevo.
page-import-no = Conservar lo que hay
page-import-choose = Elegir archivos
page-import-wrong = { $file } no es un archivo de Cairn con rutas y mapas. No se ha cambiado nada.
page-imported = { $count ->
    [one] Se ha cargado { $count } archivo.
   *[other] Se han cargado { $count } archivos.
}

## The page: trust in this computer

page-trust = Confiar en este ordenador
page-trust-why = Un teléfono se conecta mejor a un ordenador en el que confía. Un iPhone lo necesita para la conexión rápida; sin ello la página usa una más lenta. Basta con una vez.
page-trust-slow = Conectado por la vía más lenta: el navegador rechaza la rápida, casi siempre porque no confía en el certificado de este ordenador.
page-trust-how = { page-trust-slow } Abajo, Confiar en este ordenador dice qué hacer.
page-trust-say = Leer estos pasos en voz alta
page-trust-ios = iPhone y iPad:
page-trust-ios-get = Descargue el perfil con Safari y elija Permitir.
page-trust-ios-install = Abra Ajustes, elija Perfil descargado e instálelo.
page-trust-ios-on = En Ajustes, abra General, Información, Ajustes de confianza de los certificados, y active { $name }.
page-trust-android = Android:
page-trust-android-get = Descargue el certificado.
page-trust-android-install = Abra Ajustes, busque «certificado CA», elija Instalar de todos modos y elija el archivo.
page-trust-open = Abra la página otra vez.
page-trust-profile = Descargar el perfil
page-trust-certificate = Descargar el certificado
page-trust-compare = Antes de confiar, compare: los detalles de { $name } en el teléfono y el terminal del ordenador deben mostrar la misma huella SHA-256, { $fingerprint }.
page-trust-not-local = Una dirección de este ordenador no es de una red local: esta autoridad no puede responder por ella, y los teléfonos no confiarán allí en la página.
