# What Cairn says and shows to a walker, in German. The comments on the ids are in en.ftl.
#
# Directions and buttons are infinitives ("links abbiegen", "Aufnahme beenden"): short, and polite to everybody. Requests with a reason are
# sentences with "Sie". A distance has a dative for
# "in 6 Metern".

## Distances

distance = { $unit ->
    [feet] { $distance } Fuß
    [steps] { $distance ->
        [one] { $distance } Schritt
       *[other] { $distance } Schritte
    }
   *[metres] { $distance } Meter
}
    .dative = { $unit ->
        [feet] { $distance } Fuß
        [steps] { $distance ->
            [one] { $distance } Schritt
           *[other] { $distance } Schritten
        }
       *[metres] { $distance ->
            [one] { $distance } Meter
           *[other] { $distance } Metern
        }
    }

## Clauses of the guide

guide-turn = { $kind ->
    [corner] { $to ->
        [left] links abbiegen
        [right] rechts abbiegen
        [slightly-left] leicht links abbiegen
        [slightly-right] leicht rechts abbiegen
        [sharp-left] scharf links abbiegen
        [sharp-right] scharf rechts abbiegen
       *[around] umdrehen
    }
   *[spot] { $to ->
        [left] nach links drehen
        [right] nach rechts drehen
        [slightly-left] etwas nach links drehen
        [slightly-right] etwas nach rechts drehen
        [sharp-left] weit nach links drehen
        [sharp-right] weit nach rechts drehen
       *[around] umdrehen
    }
}
guide-turn-clock = { $kind ->
    [corner] auf { $hour } Uhr abbiegen
   *[spot] auf { $hour } Uhr drehen
}
guide-turn-degrees = { $kind ->
    [corner] { $degrees } Grad { $side ->
        [left] links
       *[right] rechts
    } abbiegen
   *[spot] { $degrees } Grad nach { $side ->
        [left] links
       *[right] rechts
    } drehen
}
guide-bear = { $kind ->
    [back] ein wenig nach { $side ->
        [left] links
       *[right] rechts
    } drehen
   *[other] etwas { $side ->
        [left] links
       *[right] rechts
    } halten
}
guide-stairs = { $way ->
    [up] die Treppe hinauf
   *[down] die Treppe hinunter
}
guide-turn-and-stairs = { $turn } und { $stairs }
guide-and-stairs = , und { $stairs }
guide-arrive = ist das Ziel da
guide-continue = { distance } weitergehen
guide-continue-unmeasured = weitergehen
guide-move-slowly = langsam { distance } weitergehen
guide-move-slowly-unmeasured = langsam weitergehen
guide-move-back = { distance } rückwärtsgehen
guide-move-back-unmeasured = rückwärtsgehen
guide-after = , dann in { distance.dative } { $next }
guide-after-unmeasured = , dann bald { $next }
guide-place = { $place ->
    [ahead] vorn
    [behind] hinten
    [front] vorn
    [left] links
   *[right] rechts
}
guide-place-clock = auf { $hour } Uhr

## Sentences of the guide

guide-sentence = { CAPITAL($clause) }.
guide-go = { CAPITAL($go) }, dann { $next }{ $after }.
guide-go-end = { CAPITAL($go) } bis zum Ziel.
guide-start = Die Route ist { distance } lang.
guide-start-unmeasured = Ich kann keine Entfernungen messen.
guide-start-back = Die Kamera schaut nach hinten.
guide-start-backwards = Vorsicht, Sie gehen jetzt rückwärts. Gehen Sie langsam und nur auf ebenem Boden.
guide-join = Auf der Route, noch { distance }.
guide-join-unmeasured = Auf der Route. Ich kann keine Entfernungen messen.
guide-away = Die Route ist { distance } entfernt, { $place }. Den Boden dazwischen kenne ich nicht. Bitten Sie jemanden, Sie hinzubringen.
guide-away-unmeasured = Die Route ist { $place }. Den Boden dazwischen kenne ich nicht. Bitten Sie jemanden, Sie hinzubringen.
guide-note = { CAPITAL($text) }.
guide-note-at = { CAPITAL($text) } { $place ->
    [left] links
    [right] rechts
    [ahead] voraus
   *[behind] hinten
}.
guide-found = Ich weiß wieder, wo wir sind.
guide-clear = Der Weg ist frei.
guide-around = Daneben ist Platz. Langsamer. { CAPITAL($turn) }.
guide-around-ahead = Voraus ist Platz. Langsam weitergehen.
guide-obstacle = { $what ->
    [overhead] Etwas hängt im Weg
   *[standing] Etwas ist im Weg
}, { $near ->
    [near] einen halben Meter
   *[far] { distance }
} { $place ->
    [ahead] voraus
    [ahead-left] voraus, etwas links
    [ahead-right] voraus, etwas rechts
    [left] links von Ihnen
   *[right] rechts von Ihnen
}.
guide-correction = Korrektur.
guide-stop = Halt.
guide-stop-turning = Nicht weiter drehen.
guide-stand-still = Halt. Stehen bleiben.
guide-approach = In { distance.dative } { $next }{ $after }.
guide-approach-unmeasured = Bald { $next }{ $after }.
guide-approach-end = Langsamer, { distance } bis zum Ziel.
guide-approach-end-unmeasured = Langsamer, das Ziel ist nah.
guide-turn-now = Jetzt { $turn }{ $stairs }.
guide-turn-now-back = Halt. { CAPITAL($turn) }{ $stairs }.
guide-stairs-now = Jetzt kommt die Treppe, { $stairs }.
guide-progress = Noch { distance }, dann { $next }.
guide-progress-unmeasured = Weiter auf der Route, dann { $next }.
guide-progress-end = Noch { distance } bis zum Ziel.
guide-progress-end-unmeasured = Weiter auf der Route bis zum Ziel.
guide-off-path = Neben der Route. { CAPITAL($turn) }, sie ist { distance } entfernt.
guide-off-path-unmeasured = Neben der Route. { CAPITAL($turn) }.
guide-off-path-place = Neben der Route. Sie liegt { distance } entfernt, { $place }.
guide-off-path-place-unmeasured = Neben der Route. Sie liegt { $place }.
guide-wrong-way = Falsche Richtung. { CAPITAL($turn) }.
guide-on-path = Sie sind auf der Route.
guide-check-behind = Mit dem Stock nach hinten tasten.
guide-step-aside = Halt. Einen Schritt zurück und nach { $side ->
    [left] links
   *[right] rechts
}.
guide-small-step = Einen kleinen Schritt nach { $side ->
    [left] links
   *[right] rechts
}.
guide-slow-down = Langsamer.
guide-weak = Langsamer. Ich sehe nicht gut.
guide-end-missed = Halt. { CAPITAL($turn) }, das Ziel ist { distance } entfernt.
guide-end-missed-unmeasured = Halt. { CAPITAL($turn) }, das Ziel ist nah.
guide-arrived = Halt. Sie sind am Ziel. Die Führung endet.
guide-look-round = Ich suche, wo wir sind. { CAPITAL($turn) }.

## Why the walker must stop

stop-tracking-lost = Ich weiß nicht, wo wir sind.
stop-no-picture = Von der Kamera kommt kein Bild.
stop-pictures-late = Die Bilder kommen zu spät.
stop-age-unknown = Ich weiß nicht, wie alt die Bilder sind.
stop-obstacle = Etwas ist im Weg.
stop-overhead = Etwas hängt im Weg.
stop-drop = Der Boden fällt vor uns ab.
stop-unknown-ground = Ich sehe den Boden vor uns nicht.
stop-no-way-past = Ich finde keinen Weg daran vorbei.
stop-scale = Hier kann ich Entfernungen nicht beurteilen.{ $camera ->
    [ahead] {" "}Es hilft, zurückzudrehen und rückwärts zu gehen, oder die Kamera nach hinten schauen zu lassen.
   *[back] {""}
}
stop-relocalise = Hier weiß ich immer wieder nicht, wo wir sind, und kann Sie nicht weiter führen. Bitten Sie jemanden, Sie ein paar Meter weiter zu bringen.{ $camera ->
    [ahead] {" "}Es hilft auch, rückwärts zu gehen oder die Kamera nach hinten schauen zu lassen.
   *[back] {""}
}
stop-to-and-fro = Hier führe ich Sie nur hin und her und kann Sie nicht weiter führen. Bitten Sie jemanden, Sie ein paar Meter weiter zu bringen.{ $camera ->
    [ahead] {" "}Es hilft auch, rückwärts zu gehen oder die Kamera nach hinten schauen zu lassen.
   *[back] {""}
}
stop-stage-died = Ein Teil der Führung arbeitet nicht mehr.

## Before leaving: will the route be recognised?

ready-none = Es gibt noch keine Route.
ready-all = Diese Route sollte ich ganz wiedererkennen.
ready-hard = Etwa { distance } dieser Route werde ich schwer wiedererkennen.
ready-hard-unmeasured = Einen Teil dieser Route werde ich schwer wiedererkennen.
ready-hard-all = Diese Route werde ich schwer wiedererkennen.
ready-unseen = Etwa { distance } dieser Route habe ich aus dieser Richtung nicht gesehen. Wenn ich dort nicht weiß, wo wir sind, bitte ich anzuhalten.
ready-unseen-unmeasured = Einen Teil dieser Route habe ich aus dieser Richtung nicht gesehen. Wenn ich dort nicht weiß, wo wir sind, bitte ich anzuhalten.
ready-unseen-all = Diese Route habe ich aus dieser Richtung nicht gesehen. Wenn ich nicht weiß, wo wir sind, bitte ich anzuhalten.
ready-camera-back = Mit der Kamera nach hinten sollte ich sie wiedererkennen.

## Answers and news of a walk

walk-recording = Aufnahme läuft.
walk-recording-unmeasured = Aufnahme läuft. Entfernungen kann ich noch nicht messen.
walk-recording-in-memory = Aufnahme nur im Speicher: Die Route gilt, bis ich ausgeschaltet werde, denn { $file } lässt sich nicht schreiben: { $why }.
walk-already-recording = Die Aufnahme läuft schon.
walk-not-recording = Es läuft keine Aufnahme.
walk-recorded = Aufnahme beendet, { distance }.
walk-recorded-unmeasured = Aufnahme beendet.
walk-nothing-recorded = Aufnahme beendet. Es wurde nichts aufgenommen.
walk-file-incomplete = Aufnahme beendet, aber die Datei ist nicht vollständig. Die Route gilt, bis ich ausgeschaltet werde. Der Computer meldet: { $why }.
walk-no-route = Es gibt noch keine Route. Nehmen Sie erst eine auf, oder laden Sie eine.
walk-no-saved-route = Es gibt keine aufgenommene Route zum Laden.
walk-routes-none = Es gibt keine aufgenommene Route.
walk-routes = { $count ->
    [one] Eine Route.
   *[other] { $count } Routen.
}
walk-routes-older = { $count ->
    [one] Und eine ältere Route.
   *[other] Und { $count } ältere Routen.
}
walk-route-number = Route { $number }
walk-route-named = Route { $number }, { $name }
walk-when = { $days ->
    [0] von heute
    [1] von gestern
   *[other] von vor { $days } Tagen
}
walk-when-weeks = von vor { $weeks } Wochen
walk-when-months = von vor { $months } Monaten
walk-when-years = von vor { $years } Jahren
walk-with-notes = { $count ->
    [one] mit einer Notiz
   *[other] mit { $count } Notizen
}
walk-route-lens-unknown = aufgenommen, bevor ich dieses Telefon kannte
walk-route-loaded = { $route }. Geladen.
walk-route-loaded-elsewhere = { $route }. Geladen, aber ich kann Sie darauf nicht führen: { $why }.
walk-why-other-map = sie wurde mit einer anderen Kamera oder auf einer anderen Karte aufgenommen
walk-why-guessed = ich kannte dieses Telefon noch nicht, als sie aufgenommen wurde. Bitte nehmen Sie sie noch einmal auf
walk-why-damaged = ihre Datei ist beschädigt
walk-unknown-route = Es gibt keine Route { $number }.
walk-no-route-at-hand = Es ist keine Route geladen. Laden Sie erst eine.
walk-renamed = Neuer Name: { $route }.
walk-name-empty = Der Name ist leer.
walk-name-long = Der Name ist zu lang.
walk-name-unsayable = Der Name hat Zeichen, die man nicht sprechen kann.
walk-rename-failed = Die Route lässt sich nicht benennen: { $why }.
walk-ask-delete = Soll ich diese Route löschen? { $route }. Antworten Sie mit Ja oder Nein.
walk-deleted = { $route }: gelöscht.
walk-delete-failed = Die Route lässt sich nicht löschen: { $why }.
walk-nothing-deleted = Es wurde nichts gelöscht.
walk-no-question = Es ist keine Frage offen.
walk-being-recorded = Diese Route wird gerade aufgenommen. Beenden Sie erst die Aufnahme.
walk-stop-first = Ich nehme gerade auf. Beenden Sie erst die Aufnahme.
walk-halt-first = Die Führung läuft. Beenden Sie sie zuerst.
walk-note-no-recording = Notizen gehören zu einer Route. Beginnen Sie erst die Aufnahme.
walk-note-no-place = Ich weiß nicht, wo wir sind. Versuchen Sie die Notiz gleich noch einmal.
walk-note-too-many = Diese Route hat zu viele Notizen.
walk-note-too-long = Diese Notiz ist zu lang.
walk-marked = Der Ort ist gemerkt. Schreiben Sie, was hier ist.
walk-noted = Notiert: { $text }.
walk-noted-side = Notiert: { $text } { $side ->
    [left] links
   *[right] rechts
}.
walk-landmark = Orientierungspunkt
walk-searching = Diesen Ort erkenne ich noch nicht. Drehen Sie sich langsam auf der Stelle, oder gehen Sie näher zur Route.
walk-map-not-saved = Die Karte lässt sich nicht speichern: { $why }. Die Routen von heute gelten, bis ich ausgeschaltet werde.
walk-map-saved = Die Karte wird wieder gespeichert.
walk-library-full = Aufnahme nur im Speicher, weil für weitere Routen kein Platz ist. Löschen Sie erst einige.
walk-route-unreadable = Die Route ist nicht lesbar: { $why }.
walk-route-empty = Diese Route ist leer.
walk-other-map = Diese Route wurde mit einer anderen Kamera oder auf einer anderen Karte aufgenommen. Hier kann ich Sie darauf nicht führen.
walk-way-here-unknown = Ich weiß noch nicht, wo Sie sind.
walk-way-unknown = Ich kenne keinen Ort namens { $place }. { walk-way-places }
walk-way-places = { $count ->
    [0] Ich kenne keinen Ort, zu dem ich führen kann: Auf dieser Karte ist keine Route aufgenommen.
   *[other] Ich kann zu diesen Orten führen: { $places }.
}
walk-way-place = { $end ->
    [start] Anfang von { $route }
   *[end] Ende von { $route }
}
walk-way-route = Route { $number }
walk-way-going = Ziel: { $place }, { distance }.
walk-way-going-unmeasured = Ziel: { $place }.
walk-way-ambiguous = Ich kenne mehr als einen Ort namens { $place }.
walk-way-other-map = Ich kenne den Weg zu { $place } nicht: Noch kein Weg hat den Ort mit dieser Karte verbunden.
walk-way-far = Sie sind zu weit von den aufgezeichneten Wegen entfernt, um zu { $place } geführt zu werden.
walk-way-not-joined = Ich kenne den Weg zu { $place } nicht: Kein aufgezeichneter Weg führt von hier dorthin.
walk-way-there = Sie sind schon dort.
walk-route-too-short = Ich kann Sie nicht führen: Die Route ist zu kurz.
walk-stairs-backwards = Ich kann Sie nicht führen: Die Route hat Treppen, und die sind nichts zum Rückwärtsgehen.
walk-route-guessed = Ich kann Sie nicht führen: Als diese Route aufgenommen wurde, kannte ich dieses Telefon noch nicht gut genug. Bitte nehmen Sie diese Route noch einmal auf.
walk-route-damaged = Ich kann Sie nicht führen: Die Route ist beschädigt.
walk-guidance-begins = Die Führung beginnt.
walk-guidance-ended = Führung beendet.
walk-paused = Die Führung pausiert.
walk-resumed = Die Führung geht weiter.
walk-not-paused = Die Führung pausiert nicht.
walk-not-guiding = Es läuft keine Führung.
walk-goodbye = Auf Wiedersehen.
walk-nothing-to-repeat = Ich habe noch nichts gesagt.
walk-in-memory = im Speicher
walk-set = Erledigt.
walk-picture-back = Das Bild ist wieder da.
walk-no-picture = Von der Kamera kommt kein Bild. Bleiben Sie stehen.
walk-mapping-failed = Halt. Die Karte ist ausgefallen. Beenden Sie die Aufnahme, und beginnen Sie neu.
walk-tracking-failed = Ein Fehler des Programms hat die Ortung beendet.
walk-tracking-restarts = Die Ortung beginnt neu. Bleiben Sie stehen.
walk-distances-known = Jetzt kann ich Entfernungen messen.
walk-distances-lost = Halt. Die Entfernungen stimmen nicht mehr, die Führung endet. Bitten Sie jemanden um Hilfe, oder gehen Sie zurück, woher Sie kamen.
walk-learn = Ich muss dieses Telefon erst kennenlernen. Gehen Sie eine halbe Minute umher, und biegen Sie einmal links und einmal rechts ab. Ich sage Ihnen, wenn ich so weit bin.
walk-learn-move = Gehen Sie erst ein paar Meter. Ich sage Ihnen, wenn ich so weit bin.
walk-learn-again = Auf dieser Route stimmen die Entfernungen nicht: Ich kenne das Telefon jetzt besser. Bitte nehmen Sie diese Route noch einmal auf. Ich sage Ihnen, wenn ich so weit bin.
walk-learn-no-motion = Ohne die Bewegungssensoren kann ich dieses Telefon nicht kennenlernen. Erlauben Sie sie im Browser, und laden Sie die Seite neu.
walk-learning = Ich lerne dieses Telefon kennen. Gehen Sie umher, und biegen Sie links und rechts ab.
walk-ready = Ich bin so weit. Sie können jetzt eine Route aufnehmen.
walk-imu-failed = Die Bewegungssensoren antworten nicht. Ich richte mich nach dem Bild.
walk-imu-back = Die Bewegungssensoren antworten wieder.
walk-disk-full = Die Festplatte ist voll. Die Route bleibt im Speicher.
walk-disk-again = Die Route ist wieder auf der Festplatte.
walk-lost = Ich weiß nicht, wo wir sind. Bleiben Sie stehen, oder drehen Sie sich ein Stück zurück. Die Aufnahme pausiert.
walk-age = Das Bild ist { $seconds } Sekunden alt.
walk-age-too-old = Das Bild ist { $seconds } Sekunden alt, zu alt zum Führen.
walk-age-unknown = Ich weiß nicht, wie alt das Bild ist.
walk-length-so-far = { distance } aufgenommen.
walk-to-go = Noch { distance }.
walk-percent-done = { $percent } Prozent geschafft.
walk-guiding = Führung, { page-guide-state }.

## The state of tracking

phase-loading = Ich bereite mich vor.
phase-first-image = Ich warte auf das erste Bild der Kamera.
phase-no-image = Von der Kamera kommt kein Bild.
phase-no-imu = Der Bewegungssensor antwortet nicht.
phase-points = Ich fange an. Bewegen Sie die Kamera seitwärts.
phase-unmeasured-move = Ich sehe gut, aber nicht, wie weit alles weg ist. Bewegen Sie die Kamera vor und zurück sowie auf und ab.
phase-unmeasured = Ich sehe gut, kann aber noch keine Entfernungen messen.
phase-tracking = Ich sehe gut.
phase-coasting = Ich sehe nicht gut und folge den anderen Sensoren.
phase-rotation = Ich kann nur Drehungen der Kamera folgen. Gehen Sie weiter, damit ich weiß, wo wir sind.
phase-lost = Ich weiß nicht, wo wir sind.
phase-new-map = Ich wusste nicht, wo wir sind, und habe eine neue Karte begonnen. Die alte bleibt erhalten.
phase-error = Etwas stimmt nicht.
phase-error-why = Etwas stimmt nicht: { $why }.

## What is waited for

wait-points = mehr, was zu sehen ist, um eine Karte anzufangen
wait-parallax = eine Seitwärtsbewegung der Kamera
wait-imu = einen Messwert des Bewegungssensors
wait-first-try = mehr Weg, um Entfernungen zu messen
wait-time = mehr Zeit, um Entfernungen zu messen
wait-excitation = lebhaftere Bewegung, um Entfernungen zu messen
wait-baseline = einen längeren Weg, um Entfernungen zu messen
wait-precision = eine bessere Messung der Entfernungen
wait-matches = etwas, das schon zu sehen war
wait-translation = einen Schritt zur Seite oder nach vorn
wait-place = einen Ort, den ich kenne

## Keys and commands

key-record = aufnehmen
key-stop = Aufnahme beenden
key-note = Orientierungspunkt notieren
key-routes = Routen ansagen
key-delete = geladene Route löschen
key-yes = ja
key-no = nein
key-load = die letzte Route laden
key-guide = nach Hause führen
key-take-me = sagen, wohin ich geführt werden kann
key-backwards = rückwärts führen
key-pause = Führung pausieren
key-resume = Führung fortsetzen
key-halt = Führung beenden
key-repeat = noch einmal sagen
key-status = sagen, wo ich bin
key-quit = beenden
key-lines = als Zeilen auch: { $lines }

## The page: its parts

page-skip = Zu den Befehlen
page-now = Jetzt
page-words = Was ich gesagt habe
page-commands = Befehle
page-state = Zustand
page-pictures = Bilder
page-settings = Einstellungen
page-log = Alles, was gesagt wurde
page-nothing-said = Es wurde noch nichts gesagt.

## The page: commands

page-take = Steuerung übernehmen
page-take-over = Steuerung übernehmen
page-start-camera = Kamera einschalten
page-record = Aufnehmen
page-stop = Aufnahme beenden
page-guide-home = Nach Hause führen
page-guide-back = Nach Hause führen, Kamera nach hinten
page-guide-backwards = Rückwärts führen
page-pause = Führung pausieren
page-resume = Führung fortsetzen
page-halt = Führung beenden
page-load = Die letzte Route laden
page-guide-again = Vom Anfang zum Ende führen
page-take-me = Wohin kann ich geführt werden?
page-routes = Routen
page-routes-none = Es wurde noch keine Route aufgenommen.
page-routes-count = { $count ->
    [one] { $count } Route
   *[other] { $count } Routen
}
page-route-loaded = Diese Route ist geladen.
page-load-one = Laden
page-take-me-start = Zum Anfang führen
page-take-me-end = Zum Ende führen
page-rename = Benennen
page-delete = Löschen
page-labelled = { $action }: { $route }
page-notes-count = { $count ->
    [one] { $count } Notiz.
   *[other] { $count } Notizen.
}
page-why-not = Ich kann Sie darauf nicht führen: { $why }.
page-wait-picture = Auf das Bild warten
page-note = Orientierungspunkt notieren
page-anew = Neue Route aufnehmen
page-all-commands = Alle Befehle
page-say-routes = Routen ansagen
page-note-title = Was ist hier?
page-note-text = Ein paar Wörter, zum Beispiel Tür oder Brunnen
page-note-where = Wo ist es?
page-note-left = links
page-note-right = rechts
page-note-here = genau hier
page-note-voice = Mit eigener Stimme aufnehmen
page-note-voice-end = Sprachaufnahme beenden
page-note-voice-again = Noch einmal mit eigener Stimme aufnehmen
page-note-voice-name = Sprachnotiz { $number }
page-note-voice-refused = Ich darf das Mikrofon nicht benutzen. Erlauben Sie es für diese Seite in den Einstellungen des Browsers, oder schreiben Sie die Notiz.
page-note-voice-lost = Ihre Stimme lässt sich in diesem Browser nicht speichern. Die Notiz hat nur ihre Nummer.
page-note-save = Notiz speichern
page-name-text = Ihr Name, zum Beispiel zur Küche
page-name-save = Namen speichern
page-delete-title = Die Route löschen?
page-delete-no = Nein, behalten
page-delete-yes = Ja, löschen
page-map-not-saved = { $map }; nicht gespeichert: { $why }
page-repeat = Noch einmal sagen
page-status = Wo bin ich?
page-camera-refused = Ich darf die Kamera nicht benutzen. Erlauben Sie sie für diese Seite in den Einstellungen des Browsers, und drücken Sie dann Kamera einschalten.
page-camera-missing = Ich finde an diesem Gerät keine Kamera. Öffnen Sie die Seite auf einem Telefon.
page-camera-busy = Ein anderes Programm benutzt die Kamera. Schließen Sie es, und drücken Sie dann Kamera einschalten.
page-camera-failed = Die Kamera geht nicht an. Laden Sie die Seite neu, und drücken Sie dann Kamera einschalten.
page-camera-ended = Ein Anruf oder ein anderes Programm hat die Kamera genommen. Drücken Sie Kamera einschalten.
page-camera-off = Die Kamera ist aus. Drücken Sie Kamera einschalten.
page-terminal-only = Das geht nur am Terminal.
page-no-picture-yet = Ich warte auf das erste Bild.
page-missing-key = Dieses Telefon ist noch nicht verbunden.
page-walk-failed = Ich kann nicht weitermachen. Der Computer zeigt, warum.
page-walk-ended = Die Sitzung ist beendet.

## The page: what to mind, in five sentences for the ear

page-before-title = Bevor Sie anfangen
page-before-aid = Ich helfe neben Ihrem Stock oder Ihrem Hund, nicht an deren Stelle.
page-before-streets = Ich bin nicht für Straßen gedacht.
page-before-obstacles = Ohne Tiefenkamera sehe ich keine Hindernisse und keine Stufen, und ein Telefon hat hier keine.
page-before-untried = Blinde Menschen haben mich noch nicht mit echten Telefonen ausprobiert.
page-before-pictures = Ihre Bilder bleiben hier, auf Ihren eigenen Geräten.
page-before-say = Noch einmal sagen
page-before-heard = Ich habe das gehört

## The page: the first start, practice, battery and light

page-reader-ask = Benutzen Sie einen Screenreader?
page-reader-yes = Ja, er liest mir vor
page-reader-no = Nein, bitte sprechen
page-practice = Mit zehn Metern üben
page-practice-again = Diesen Schritt noch einmal sagen
page-practice-end = Übung beenden
page-practice-camera = Übung, erster Schritt. Suchen Sie drinnen einen freien Weg von zehn Metern. Drücken Sie Kamera einschalten, und gehen Sie umher, bis ich so weit bin.
page-practice-record = Zweiter Schritt. Stellen Sie sich an den Anfang Ihrer zehn Meter. Drücken Sie Aufnehmen.
page-practice-out = Dritter Schritt. Gehen Sie in Ruhe geradeaus. Ich sage Ihnen, wenn es zehn Meter sind.
page-practice-stop = Zehn Meter. Bleiben Sie stehen, und drücken Sie Aufnahme beenden.
page-practice-home = Vierter Schritt. Drücken Sie Nach Hause führen, und folgen Sie dem, was ich sage. Mit Führung pausieren schweige ich, mit Wo bin ich sage ich, wo Sie sind.
page-practice-done = Die Übung ist zu Ende. Die Übungsroute steht in Ihrer Liste, dort können Sie sie löschen.
page-battery = Der Akku ist bei { $percent } Prozent.
page-dark-now = Für die Kamera ist es zu dunkel. Machen Sie Licht, oder geben Sie die Kamera frei.
page-light-now = Es ist wieder hell genug.

## The page: a phone that the computer does not know

page-pair-title = Dieses Telefon verbinden
page-pair-code = Der Code für das Telefon: { $digits }.
page-pair-said = Der Computer sagt jetzt sechs Ziffern und zeigt sie an. Tippen Sie sie hier ein.
page-pair-wait = Zu viele falsche Codes. Warten Sie { $seconds } Sekunden, und drücken Sie dann Code noch einmal sagen.
page-pair-wrong = Das ist nicht der Code. Hören Sie noch einmal hin, und tippen Sie die sechs Ziffern ein.
page-pair-over = Das ist nicht der Code, und er gilt nicht mehr. Drücken Sie in einer halben Minute Code noch einmal sagen.
page-pair-offline = Der Computer antwortet nicht. Prüfen Sie, ob Telefon und Computer im selben Netz sind, und drücken Sie dann Code noch einmal sagen.
page-pair-digits = Die sechs Ziffern
page-pair-done = Verbinden
page-pair-again = Code noch einmal sagen
page-known-title = Kennen wir uns?
page-known = Ist das das Telefon mit Route { $number }?
page-known-named = Ist das das Telefon mit Route { $number }, { $name }?
page-known-yes = Ja, das ist es
page-known-no = Nein, ein anderes

## The page: who holds the walk

page-controls = Dieses Gerät steuert.
page-controls-now = Dieses Gerät steuert jetzt.
page-free-camera = Bereit. Schalten Sie zum Anfangen die Kamera ein.
page-free = Bereit. Der erste Befehl übernimmt die Steuerung.
page-away = Das Gerät, das steuert, ist weg. Ich warte darauf.
page-watching = Ein anderes Gerät steuert. Sie schauen zu.
page-other-holds = Ein anderes Gerät steuert.
page-taken-over = Halt. Ein anderes Gerät hat die Steuerung übernommen.
page-ask-title = Steuerung übernehmen?
page-ask = Ein anderes Gerät steuert. Wenn Sie übernehmen, führt es nicht mehr, und seine Kamera wird nicht mehr benutzt.
page-leave = Nicht übernehmen
page-over = Übernehmen

## The page: connection and age of the picture

page-connecting = Verbindung wird aufgebaut.
page-connected = Verbunden.
page-connected-to = Verbunden; die Kamera ist { $camera }.
page-not-connected-yet = Noch nicht verbunden.
page-trying-again = Nicht verbunden. Neuer Versuch.
page-connected-again = Wieder verbunden.
page-connection-lost = Die Verbindung ist weg.
page-connection-lost-retry = Die Verbindung ist weg. Neuer Versuch.
page-connection-lost-stop = Halt. Die Verbindung ist weg.
page-no-answer = Der Rechner antwortet nicht.
page-no-answer-stop = Halt. Der Rechner antwortet nicht.
page-pictures-late = Halt. Die Bilder kommen zu spät.
page-age = Bild { $seconds } s alt
page-age-about = Bild etwa { $seconds } s alt
page-age-unknown = Ich weiß nicht, wie alt das Bild ist.

## The page: the table of the state

page-tracking-label = Ortung
page-phase-label = Phase
page-imu-label = Bewegungssensor
page-recording-label = Aufnahme
page-route-label = Route
page-guidance-label = Führung
page-scale-label = Maßstab
page-map-label = Karte
page-time-label = Zeit
page-not-started = noch nicht begonnen
page-unknown-offline = ohne Verbindung nicht bekannt
page-waits = { $phase }, wartet auf { $waits }
page-not-used = nicht benutzt
page-imu = arbeitet
page-recorded = { $length } Meter, { $file }
page-recorded-units = Länge nicht bekannt, { $file }
page-not-on-disk = { $recorded }; nicht auf der Festplatte: { $why }
page-no = nein
page-none = keine
page-route = { $file }
page-route-elsewhere = { page-route }, von einer anderen Karte
page-guiding = { $facing ->
    [home] vorwärts
    [back] Kamera nach hinten
   *[backwards] rückwärts
}, { page-guide-state }, { $along } von { $length }
page-guide-state = { $state ->
    [turning] Drehung
    [moving] unterwegs
    [checking] Tasten nach hinten
    [stepping] Schritt zur Seite
    [stopped] angehalten
    [paused] Pause
    [arrived] am Ziel
   *[waiting] wartet
}
page-guiding-metres = { page-guiding } Metern
page-metres = Meter
page-no-scale = nicht bekannt, darum werden keine Entfernungen genannt
page-map-size = { $places ->
    [one] { $places } Schlüsselbild
   *[other] { $places } Schlüsselbilder
}, { $points ->
    [one] { $points } Landmarke
   *[other] { $points } Landmarken
}
page-map-empty = leer
page-time = { $clock }

## The page: pictures

page-own-label = Was diese Kamera sieht
page-own-caption = Diese Kamera.
page-picture-label = Was die führende Kamera sieht, mit Punkten auf dem, was ich wiedererkenne
page-picture-caption = Was die führende Kamera sieht; die Punkte sind, was ich wiedererkenne.
page-map-title = Karte und Route
page-map-how = So bewegt man die Karte
page-map-help = Pfeiltasten drehen die Ansicht, mit Umschalt verschieben sie sie; mit W, A, S und D geht man, mit Q und E ab- und aufwärts, Plus und Minus ändern ihre Größe, 0 zeigt alles.
page-map-follow = Der Kamera folgen
page-map-colour = Farben
page-map-height = nach Höhe
page-map-age = nach Alter
page-map-normal = nach Richtung
page-map-low = niedrig
page-map-high = hoch
page-map-old = alt
page-map-new = neu
page-map-down = zeigt nach unten
page-map-up = zeigt nach oben
page-map-surface-show = Oberfläche zeigen
page-map-points-show = Punkte zeigen
page-map-columns-show = Freien und belegten Raum zeigen
page-map-path = Weg der Kamera
page-map-recorded = aufgenommene Route
page-map-plan = bereinigte Route
page-map-loops = wiedererkannte Orte
page-map-eye = Kamera
page-map-bar = { $length } m
page-map-bar-units = { $length }
page-map-grid = Ein Quadrat des Gitters ist { $length } m breit.
page-map-grid-units = Ein Quadrat des Gitters ist { $length } Einheiten unbekannter Länge breit.
page-no-map = Es gibt noch keine Karte.
page-map-words = Eine Karte mit { $places ->
    [one] { $places } Ort
   *[other] { $places } Orten
} und { $points ->
    [one] { $points } Punkt
   *[other] { $points } Punkten
}.
page-map-surface = Die Oberfläche ist etwa { $area } Quadratmeter groß.
page-map-route = Die aufgenommene Route ist { $metres } Meter lang.
page-map-walker = { $percent } Prozent der Route sind gegangen.

## The page: settings

page-language = Sprache
page-told = Wie Anweisungen kommen
page-told-voice = mit der Stimme dieser Seite
page-told-reader = mit meinem Screenreader
page-told-silent = nur als Text und Vibration
page-unit = Entfernungen in
page-unit-metres = Metern
page-unit-feet = Fuß
page-unit-steps = Schritten
page-step = Länge eines Schritts in Zentimetern
page-directions = Richtungen
page-directions-words = links und rechts
page-directions-clock = wie auf der Uhr, „auf 2 Uhr“
page-directions-degrees = in Grad
page-speed = Wörter pro Minute
page-volume = Lautstärke
page-sounds = Kurze Töne zu den Worten
page-media = Tasten am Kopfhörer und auf dem Sperrbildschirm: Wiedergabe wiederholt, Stopp beendet die Führung
page-vibration = Vibration
page-keys = Einzelne Tasten geben Befehle: { $keys }
page-dark = Bildschirm dunkel schalten
page-dark-title = Der Bildschirm ist dunkel, um Strom zu sparen. Die Führung läuft weiter.
page-light = Bildschirm hell schalten

## The page: the engine in this device

page-here = Gerechnet wird auf diesem Gerät; kein Bild verlässt es.
page-here-stored = Alles ist hier gespeichert: Ein Netz wird nicht mehr gebraucht.
page-here-failed = Die Führung ist ausgefallen.
page-here-failed-stop = Halt. Die Führung ist ausgefallen und beginnt von neuem.
page-here-too-old = In diesem Browser kann ich nicht arbeiten. Aktualisieren Sie den Browser, oder benutzen Sie Cairn mit einem Computer.
page-here-twice = Cairn ist in einem anderen Tab dieses Browsers offen. Schließen Sie ihn, und öffnen Sie diese Seite dann neu.
page-here-turned = Das Bild hat jetzt eine andere Form. Halten Sie das Telefon wie vorher.
page-here-not-kept = Aufnahmen können in diesem Browser nicht gespeichert werden. Schaffen Sie Platz, und benutzen Sie kein privates Fenster.
page-demo = Vorführung ansehen: ein simulierter Mensch wird geführt
page-demo-leave = Vorführung verlassen
page-demo-start = Vorführung starten
page-demo-off = In dieser Vorführung geht ein simulierter Mensch hinaus und kommt allein nach diesen Worten zurück. Drücken Sie Vorführung starten.
page-demo-failed = Die Vorführung startet nicht. Sie braucht einmal das Netz; laden Sie die Seite neu.
page-demo-ended = Die Vorführung ist zu Ende. Der simulierte Mensch steht { $metres } Meter vom Start.
page-files = Routen als Dateien
page-files-why = Routen und Karten liegen allein in diesem Browser. Als Dateien lassen sie sich anderswo aufheben, auf einem Computer öffnen und wieder einlesen.
page-export = Routen und Karten als Datei speichern
page-exported = Routen und Karten sind als { $file } gespeichert.
page-import = Routen und Karten einlesen
page-import-replaces = Die Dateien ersetzen alle Routen und Karten, die hier liegen, und die Sitzung beginnt von neuem.
page-import-no = Behalten, was hier ist
page-import-choose = Dateien wählen
page-import-wrong = { $file } ist keine Datei von Cairn mit Routen und Karten. Es wurde nichts geändert.
page-imported = { $count ->
    [one] { $count } Datei wurde eingelesen.
   *[other] { $count } Dateien wurden eingelesen.
}

## The page: trust in this computer

page-trust = Diesem Computer vertrauen
page-trust-why = Ein Telefon verbindet sich am besten mit einem Computer, dem es vertraut. Ein iPhone braucht das für die schnelle Verbindung; sonst nimmt die Seite eine langsamere. Einmal genügt.
page-trust-slow = Auf dem langsameren Weg verbunden: Der Browser verweigert den schnellen, meist weil er dem Zertifikat dieses Computers nicht vertraut.
page-trust-how = { page-trust-slow } Unten steht unter Diesem Computer vertrauen, was zu tun ist.
page-trust-say = Diese Schritte vorlesen
page-trust-ios = iPhone und iPad:
page-trust-ios-get = Laden Sie das Profil mit Safari, und wählen Sie Zulassen.
page-trust-ios-install = Öffnen Sie die Einstellungen, wählen Sie Profil geladen, und installieren Sie es.
page-trust-ios-on = Öffnen Sie in den Einstellungen Allgemein, Info, Zertifikatsvertrauenseinstellungen, und schalten Sie { $name } ein.
page-trust-android = Android:
page-trust-android-get = Laden Sie das Zertifikat.
page-trust-android-install = Öffnen Sie die Einstellungen, suchen Sie nach „CA-Zertifikat“, wählen Sie Trotzdem installieren, und wählen Sie die Datei.
page-trust-open = Öffnen Sie die Seite noch einmal.
page-trust-profile = Profil laden
page-trust-certificate = Zertifikat laden
page-trust-compare = Vergleichen Sie, bevor Sie vertrauen: Die Details von { $name } auf dem Telefon und das Terminal des Computers müssen denselben SHA-256-Fingerabdruck zeigen, { $fingerprint }.
page-trust-not-local = Eine Adresse dieses Computers ist keine eines lokalen Netzes: Dafür kann diese Zertifizierungsstelle nicht stehen, und Telefone werden der Seite dort nicht vertrauen.
