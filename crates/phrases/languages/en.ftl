# What Cairn says and shows to a walker, in English.
#
# Plain words, as a sighted friend would say them. What to do comes first, so that it can be acted on while the rest is
# still being said. "Continue" and "move", never "walk": not everybody walks. CAPITAL(...) puts a capital letter at the
# beginning. $unit is metres, feet or steps.

## Distances

distance = { $unit ->
    [feet] { $distance ->
        [one] { $distance } foot
       *[other] { $distance } feet
    }
    [steps] { $distance ->
        [one] { $distance } step
       *[other] { $distance } steps
    }
   *[metres] { $distance ->
        [one] { $distance } metre
       *[other] { $distance } metres
    }
}

## Clauses of the guide. $kind is corner (a turn of the route), spot (turn while standing) or back (the walker goes
## backwards).

guide-turn = { $kind ->
    [back] rotate
   *[other] turn
} { $to ->
    [left] left
    [right] right
    [slightly-left] slightly left
    [slightly-right] slightly right
    [sharp-left] sharp left
    [sharp-right] sharp right
   *[around] around
}
guide-turn-clock = { $kind ->
    [back] rotate
   *[other] turn
} to { $hour } o'clock
guide-turn-degrees = { $kind ->
    [back] rotate
   *[other] turn
} { $side ->
    [left] left
   *[right] right
} { $degrees } degrees
guide-bear = { $kind ->
    [back] rotate { $side ->
        [left] left
       *[right] right
    } a little
   *[other] bear { $side ->
        [left] left
       *[right] right
    }
}
guide-stairs = { $way ->
    [up] go upstairs
   *[down] go downstairs
}
guide-turn-and-stairs = { $turn } and { $stairs }
guide-and-stairs = , and { $stairs }
guide-arrive = you arrive
guide-continue = continue { distance }
guide-continue-unmeasured = continue
guide-move-slowly = move slowly { distance }
guide-move-slowly-unmeasured = move slowly
guide-move-back = move back { distance }
guide-move-back-unmeasured = move back
guide-after = , then in { distance } { $next }
guide-after-unmeasured = , then soon { $next }
guide-place = { $place ->
    [ahead] ahead
    [behind] behind you
    [front] in front of you
    [left] to your left
   *[right] to your right
}
guide-place-clock = at { $hour } o'clock

## Sentences of the guide

guide-sentence = { CAPITAL($clause) }.
guide-go = { CAPITAL($go) }, then { $next }{ $after }.
guide-go-end = { CAPITAL($go) } to the end.
guide-start = The route is { distance } long.
guide-start-unmeasured = I cannot measure distances.
guide-start-back = The camera faces behind you.
guide-start-backwards = Caution, you will move backwards. Go slowly and only on flat ground.
guide-join = You are on the route, { distance } to go.
guide-join-unmeasured = You are on the route. I cannot measure distances.
guide-away = The route is { distance } away, { $place }. I do not know the ground between. Ask for help to reach it.
guide-away-unmeasured = The route is { $place }. I do not know the ground between. Ask for help to reach it.
guide-note = { CAPITAL($text) }.
guide-note-at = { CAPITAL($text) } { $place ->
    [left] on your left
    [right] on your right
    [ahead] ahead
   *[behind] behind you
}.
guide-found = I found my place.
guide-clear = The way is clear.
guide-around = There is room beside it. Slow down. { CAPITAL($turn) }.
guide-around-ahead = There is room ahead. Move slowly.
guide-obstacle = { $what ->
    [overhead] Something is hanging in the way
   *[standing] Something is in the way
}, { $near ->
    [near] half a metre
   *[far] { distance }
} { $place ->
    [ahead] ahead
    [ahead-left] ahead, a little to your left
    [ahead-right] ahead, a little to your right
    [left] to your left
   *[right] to your right
}.
guide-correction = Correction.
guide-stop = Stop.
guide-stop-turning = Stop turning.
guide-stand-still = Stop. Stand still.
guide-approach = In { distance }, { $next }{ $after }.
guide-approach-unmeasured = Soon, { $next }{ $after }.
guide-approach-end = Slow down, { distance } to the end.
guide-approach-end-unmeasured = Slow down, you are nearly there.
guide-turn-now = { CAPITAL($turn) } now{ $stairs }.
guide-turn-now-back = Stop. { CAPITAL($turn) }{ $stairs }.
guide-stairs-now = Stairs now, { $stairs }.
guide-progress = Another { distance }, then { $next }.
guide-progress-unmeasured = Still on the path, then { $next }.
guide-progress-end = Another { distance } to the end.
guide-progress-end-unmeasured = Still on the path to the end.
guide-off-path = Off the path. { CAPITAL($turn) }, it is { distance } away.
guide-off-path-unmeasured = Off the path. { CAPITAL($turn) }.
guide-off-path-place = Off the path. It is { distance } { $place }.
guide-off-path-place-unmeasured = Off the path. It is { $place }.
guide-wrong-way = Wrong way. { CAPITAL($turn) }.
guide-on-path = You are on the path.
guide-check-behind = Feel behind you with the cane.
guide-step-aside = Stop. Step back and to your { $side ->
    [left] left
   *[right] right
}.
guide-small-step = Take a small step to your { $side ->
    [left] left
   *[right] right
}.
guide-slow-down = Slow down.
guide-weak = Slow down. I cannot see well.
guide-end-missed = Stop. { CAPITAL($turn) }, the end is { distance } away.
guide-end-missed-unmeasured = Stop. { CAPITAL($turn) }, the end is close.
guide-arrived = Stop. You have arrived. Guidance ends.
guide-look-round = Let me find my place. { CAPITAL($turn) }.

## Why the walker must stop

stop-tracking-lost = I lost my place.
stop-no-picture = No picture from the camera.
stop-pictures-late = The pictures come too late.
stop-age-unknown = I do not know how old the pictures are.
stop-obstacle = Something is in the way.
stop-overhead = Something is hanging in the way.
stop-drop = The ground drops ahead.
stop-unknown-ground = I cannot see the ground ahead.
stop-no-way-past = I cannot find a way past it.
stop-scale = I cannot judge distances here.{ $camera ->
    [ahead] {" "}It helps to turn back and move backwards, or to let the camera face back.
   *[back] {""}
}
stop-relocalise = I keep losing my place here and cannot guide you on. Ask for help to get a few metres further.{ $camera ->
    [ahead] {" "}It also helps to move backwards, or to let the camera face back.
   *[back] {""}
}
stop-to-and-fro = I keep leading you back and forth here and cannot guide you on. Ask for help to get a few metres further.{ $camera ->
    [ahead] {" "}It also helps to move backwards, or to let the camera face back.
   *[back] {""}
}
stop-stage-died = Part of the guide has stopped working.

## Before leaving: will the route be recognised?

ready-none = There is no route yet.
ready-all = I should recognise this whole route.
ready-hard = About { distance } of this route will be hard for me to recognise.
ready-hard-unmeasured = Part of this route will be hard for me to recognise.
ready-hard-all = This route will be hard for me to recognise.
ready-unseen = I have not seen about { distance } of this route from this direction. If I lose my place there, I will ask you to stop.
ready-unseen-unmeasured = I have not seen part of this route from this direction. If I lose my place there, I will ask you to stop.
ready-unseen-all = I have not seen this route from this direction. If I lose my place, I will ask you to stop.
ready-camera-back = With the camera facing back, I should recognise it.

## Answers and news of a walk

walk-recording = Recording.
walk-recording-unmeasured = Recording. I cannot measure distances yet.
walk-recording-in-memory = Recording in memory only: the route lasts until I am switched off, because { $file } cannot be written: { $why }.
walk-already-recording = I am already recording.
walk-not-recording = I am not recording.
walk-recorded = Recording has ended, { distance }.
walk-recorded-unmeasured = Recording has ended.
walk-nothing-recorded = Recording has ended. Nothing was recorded.
walk-file-incomplete = Recording has ended, but its file is not whole. The route lasts until I am switched off. The computer says: { $why }.
walk-no-route = There is no route yet. Record or load one first.
walk-no-saved-route = There is no recorded route to load.
walk-routes-none = There is no recorded route.
walk-routes = { $count ->
    [one] One route.
   *[other] { $count } routes.
}
walk-routes-older = { $count ->
    [one] And one older route.
   *[other] And { $count } older routes.
}
walk-route-number = Route { $number }
walk-route-named = Route { $number }, { $name }
walk-when = { $days ->
    [0] today
    [1] yesterday
   *[other] { $days } days ago
}
walk-when-weeks = { $weeks } weeks ago
walk-when-months = { $months } months ago
walk-when-years = { $years } years ago
walk-with-notes = { $count ->
    [one] with one note
   *[other] with { $count } notes
}
walk-route-lens-unknown = recorded before I knew this phone
walk-route-loaded = { $route }. Loaded.
walk-route-loaded-elsewhere = { $route }. Loaded, but I cannot guide along it: { $why }.
walk-why-other-map = it was recorded with another camera or on another map
walk-why-guessed = it was recorded before I knew this phone. Please record it again
walk-why-damaged = its file is damaged
walk-unknown-route = There is no route { $number }.
walk-no-route-at-hand = No route is loaded. Load one first.
walk-renamed = New name: { $route }.
walk-name-empty = The name is empty.
walk-name-long = The name is too long.
walk-name-unsayable = The name has characters that cannot be spoken.
walk-rename-failed = The route cannot be named: { $why }.
walk-ask-delete = Shall I delete this route? { $route }. Answer yes or no.
walk-deleted = { $route } is deleted.
walk-delete-failed = The route cannot be deleted: { $why }.
walk-nothing-deleted = Nothing was deleted.
walk-no-question = There is no question to answer.
walk-being-recorded = That route is being recorded. Stop the recording first.
walk-stop-first = I am recording. Stop the recording first.
walk-halt-first = Guidance is running. Stop it first.
walk-note-no-recording = Notes belong to a route. Start recording first.
walk-note-no-place = I do not know where I am. Try the note again in a moment.
walk-note-too-many = This route has too many notes.
walk-note-too-long = That note is too long.
walk-marked = The place is marked. Type what is here.
walk-noted = Noted: { $text }.
walk-noted-side = Noted: { $text } on the { $side ->
    [left] left
   *[right] right
}.
walk-landmark = landmark
walk-searching = I do not recognise this place yet. Turn slowly on the spot, or go nearer to the route.
walk-map-not-saved = The map cannot be saved: { $why }. Today's routes can be used until I am switched off.
walk-map-saved = The map is saved again.
walk-library-full = Recording in memory only, because there is no room for more routes. Delete some first.
walk-route-unreadable = The route cannot be read: { $why }.
walk-route-empty = That route is empty.
walk-other-map = That route was recorded with another camera or on another map. I cannot guide you along it here.
walk-way-here-unknown = I do not know yet where you are.
walk-way-unknown = I do not know a place called { $place }. { walk-way-places }
walk-way-places = { $count ->
    [0] I know no place to take you to: no route was recorded on this map.
   *[other] I can take you to: { $places }.
}
walk-way-place = { $end ->
    [start] the start of { $route }
   *[end] the end of { $route }
}
walk-way-route = route { $number }
walk-way-going = Going to { $place }, { distance }.
walk-way-going-unmeasured = Going to { $place }.
walk-way-ambiguous = I know more than one place called { $place }.
walk-way-other-map = I do not know the way to { $place }: no recorded route joins it to this map yet.
walk-way-far = You are too far from the recorded routes to be taken to { $place }.
walk-way-not-joined = I do not know the way to { $place }: no recorded route leads there from here.
walk-way-there = You are there already.
walk-route-too-short = I cannot guide you: the route is too short.
walk-stairs-backwards = I cannot guide you: the route has stairs, and they are not for going backwards.
walk-route-guessed = I cannot guide you: I did not know this phone well enough when this route was recorded. Please record this route again.
walk-route-damaged = I cannot guide you: the route is damaged.
walk-guidance-begins = Guidance begins.
walk-guidance-ended = Guidance has ended.
walk-paused = Guidance is paused.
walk-resumed = Guidance goes on.
walk-not-paused = Guidance is not paused.
walk-not-guiding = Guidance is not running.
walk-goodbye = Goodbye.
walk-nothing-to-repeat = I have not said anything yet.
walk-in-memory = in memory
walk-set = Done.
walk-picture-back = The picture is back.
walk-no-picture = No picture from the camera. Stand still.
walk-mapping-failed = Stop. I can no longer build the map. End the recording, and start again.
walk-tracking-failed = Tracking was stopped by an error of the program.
walk-tracking-restarts = Tracking is starting again. Stand still.
walk-distances-known = I can measure distances now.
walk-distances-lost = Stop. I have lost the distances, and guidance ends. Ask someone for help, or go back the way you came.
walk-learn = Let me learn this phone. Move about for half a minute, turn left once and right once. I tell you when I am ready.
walk-learn-move = Move a few metres first. I tell you when I am ready.
walk-learn-again = Distances are wrong on this route: I know this phone better now. Please record this route again. I tell you when I am ready.
walk-learn-no-motion = I cannot learn this phone without its motion sensors. Allow them in the browser, and load the page again.
walk-learning = I am learning this phone. Move about, and turn left and right.
walk-ready = I am ready. You can record a route now.
walk-imu-failed = The motion sensors do not answer. I go on by sight.
walk-imu-back = The motion sensors answer again.
walk-disk-full = The disk is full. The route is kept in memory.
walk-disk-again = The route is on disk again.
walk-lost = I lost my place. Stand still, or turn back a little. Recording is paused.
walk-age = The picture is { $seconds } seconds old.
walk-age-too-old = The picture is { $seconds } seconds old, too old to guide.
walk-age-unknown = I do not know how old the picture is.
walk-length-so-far = { distance } recorded.
walk-to-go = { distance } to go.
walk-percent-done = { $percent } percent done.
walk-guiding = Guiding, { page-guide-state }.

## The state of tracking, for the person who holds the camera

phase-loading = Getting ready.
phase-first-image = Waiting for the first camera image.
phase-no-image = No image from the camera.
phase-no-imu = The motion sensor is not responding.
phase-points = Starting up. Move the camera sideways.
phase-unmeasured-move = I can see well, but not how far things are. Move the camera back and forth, and up and down.
phase-unmeasured = I can see well, but I cannot measure distances yet.
phase-tracking = I can see well.
phase-coasting = I cannot see well, and follow by the other sensors.
phase-rotation = I can only follow turns of the camera. Move on, so that I can tell where we are.
phase-lost = I lost my place.
phase-new-map = I lost my place and started a new map. The old one is kept.
phase-error = Something is wrong.
phase-error-why = Something is wrong: { $why }.

## What is waited for, as a part of a list

wait-points = more to see, to start a map
wait-parallax = sideways motion of the camera
wait-imu = a reading of the motion sensor
wait-first-try = more of the way, to measure distances
wait-time = more time, to measure distances
wait-excitation = livelier motion, to measure distances
wait-baseline = a longer way, to measure distances
wait-precision = a better measurement of distances
wait-matches = something that was seen before
wait-translation = a step to the side or forwards
wait-place = a place that I know

## Keys and commands

key-record = record
key-stop = stop recording
key-note = note a landmark
key-routes = say the routes
key-delete = delete the loaded route
key-yes = yes
key-no = no
key-load = load the latest route
key-guide = guide home
key-take-me = say where I can be taken
key-backwards = guide backwards
key-pause = pause guidance
key-resume = go on with guidance
key-halt = stop guidance
key-repeat = say it again
key-status = say where I am
key-quit = quit
key-lines = with lines also: { $lines }

## The page: its parts

page-skip = Skip to the commands
page-now = Now
page-words = What I said
page-commands = Commands
page-state = State
page-pictures = Pictures
page-settings = Settings
page-log = Everything that was said
page-nothing-said = Nothing has been said yet.

## The page: commands

page-take = Take control
page-take-over = Take over
page-start-camera = Start the camera
page-record = Record
page-stop = Stop recording
page-guide-home = Guide home
page-guide-back = Guide home, camera facing back
page-guide-backwards = Guide backwards
page-pause = Pause
page-resume = Go on
page-halt = Stop guidance
page-load = Load the latest route
page-guide-again = Guide from start to end
page-take-me = Where can you take me?
page-routes = Routes
page-routes-none = No route has been recorded yet.
page-routes-count = { $count ->
    [one] { $count } route
   *[other] { $count } routes
}
page-route-loaded = This route is loaded.
page-load-one = Load
page-take-me-start = Take me to its start
page-take-me-end = Take me to its end
page-rename = Rename
page-delete = Delete
page-labelled = { $action }: { $route }
page-notes-count = { $count ->
    [one] { $count } note.
   *[other] { $count } notes.
}
page-why-not = I cannot guide along it: { $why }.
page-wait-picture = Wait for the picture
page-note = Note a landmark
page-anew = Record a new route
page-all-commands = All commands
page-say-routes = Say the routes
page-note-title = What is here?
page-note-text = A few words, such as door or drinking fountain
page-note-where = Where is it?
page-note-left = on the left
page-note-right = on the right
page-note-here = right here
page-note-voice = Record your voice
page-note-voice-end = End the recording of your voice
page-note-voice-again = Record your voice again
page-note-voice-name = Voice note { $number }
page-note-voice-refused = I may not use the microphone. Allow it for this page in the settings of the browser, or type the note.
page-note-voice-lost = Your voice cannot be kept in this browser. The note has its number alone.
page-note-save = Save the note
page-name-text = Its name, such as to the kitchen
page-name-save = Save the name
page-delete-title = Delete the route?
page-delete-no = No, keep it
page-delete-yes = Yes, delete it
page-map-not-saved = { $map }; not saved: { $why }
page-repeat = Say it again
page-status = Where am I?
page-camera-refused = I may not use the camera. Allow it for this page in the settings of the browser, then press Start the camera.
page-camera-missing = I find no camera on this device. Open the page on a phone.
page-camera-busy = Another program is using the camera. Close it, then press Start the camera.
page-camera-failed = The camera does not start. Load the page again, then press Start the camera.
page-camera-ended = The camera was taken away, by a call or another program. Press Start the camera.
page-camera-off = The camera is off. Press Start the camera.
page-terminal-only = That can only be done at the terminal.
page-no-picture-yet = Waiting for the first picture.
page-missing-key = This phone is not paired yet.
page-walk-failed = I cannot go on. The computer shows why.
page-walk-ended = This session has ended.

## The page: what to mind, in five sentences for the ear

page-before-title = Before you start
page-before-aid = I am an aid beside your cane or your dog, not instead of them.
page-before-streets = I am not for streets.
page-before-obstacles = Without a depth camera I see no obstacles and no steps, and a phone has none here.
page-before-untried = Blind people have not yet tried me on real phones.
page-before-pictures = Your pictures stay here, on your own devices.
page-before-say = Say it again
page-before-heard = I have heard this

## The page: the first start, practice, battery and light

page-reader-ask = Do you use a screen reader?
page-reader-yes = Yes, it reads to me
page-reader-no = No, speak to me
page-practice = Practise with ten metres
page-practice-again = Say this step again
page-practice-end = End practice
page-practice-camera = Practice, first step. Find a clear way of ten metres, indoors. Press Start the camera, and move about until I am ready.
page-practice-record = Second step. Stand at the beginning of your ten metres. Press Record.
page-practice-out = Third step. Move straight on, in your own time. I tell you when it is ten metres.
page-practice-stop = Ten metres. Stand still, and press Stop recording.
page-practice-home = Fourth step. Press Guide home, and follow what I say. Pause makes me silent, Where am I repeats where you are.
page-practice-done = Practice is over. The practice route is in your list, where you can delete it.
page-battery = The battery is at { $percent } percent.
page-dark-now = It is too dark for the camera. Turn on a light, or uncover the camera.
page-light-now = It is light enough again.

## The page: a phone that the computer does not know

page-pair-title = Pair this phone
page-pair-code = The code for the phone: { $digits }.
page-pair-said = The computer says six digits now, and shows them. Type them here.
page-pair-wait = Too many wrong codes. Wait { $seconds } seconds, then press Say the code again.
page-pair-wrong = That is not the code. Listen once more, and type the six digits.
page-pair-over = That is not the code, and it is no longer valid. Press Say the code again in half a minute.
page-pair-offline = The computer does not answer. Check that phone and computer are in the same network, then press Say the code again.
page-pair-digits = The six digits
page-pair-done = Pair
page-pair-again = Say the code again
page-known-title = Have we met?
page-known = Is this the phone with route { $number }?
page-known-named = Is this the phone with route { $number }, { $name }?
page-known-yes = Yes, it is
page-known-no = No, another phone

## The page: who holds the walk

page-controls = You are in control.
page-controls-now = You are in control now.
page-free-camera = Ready. Start the camera to begin.
page-free = Ready. The first command takes control.
page-away = The device in control is away. I wait for it.
page-watching = Another device is in control. You watch.
page-other-holds = Another device is in control.
page-taken-over = Stop. Another device has taken control.
page-ask-title = Take control?
page-ask = Another device is in control. If you take over, it guides no longer, and its camera is not used any more.
page-leave = Leave it
page-over = Take over

## The page: connection and age of the picture

page-connecting = Connecting.
page-connected = Connected.
page-connected-to = Connected; the camera is { $camera }.
page-not-connected-yet = Not connected yet.
page-trying-again = Not connected. Trying again.
page-connected-again = Connected again.
page-connection-lost = The connection is lost.
page-connection-lost-retry = The connection is lost. Trying again.
page-connection-lost-stop = Stop. The connection is lost.
page-no-answer = The computer does not answer.
page-no-answer-stop = Stop. The computer does not answer.
page-pictures-late = Stop. The pictures come too late.
page-age = Picture { $seconds } s old
page-age-about = Picture about { $seconds } s old
page-age-unknown = I do not know how old the picture is.

## The page: the table of the state

page-tracking-label = Tracking
page-phase-label = Phase
page-imu-label = Motion sensor
page-recording-label = Recording
page-route-label = Route
page-guidance-label = Guidance
page-scale-label = Scale
page-map-label = Map
page-time-label = Time
page-not-started = not started
page-unknown-offline = not known without a connection
page-waits = { $phase }, waits for { $waits }
page-not-used = not used
page-imu = working
page-recorded = { $length } metres, { $file }
page-recorded-units = length not known, { $file }
page-not-on-disk = { $recorded }; not on disk: { $why }
page-no = no
page-none = none
page-route = { $file }
page-route-elsewhere = { page-route }, of another map
page-guiding = { $facing ->
    [home] facing home
    [back] camera facing back
   *[backwards] going backwards
}, { page-guide-state }, { $along } of { $length }
page-guide-state = { $state ->
    [turning] turning
    [moving] moving
    [checking] feeling behind
    [stepping] stepping aside
    [stopped] stopped
    [paused] paused
    [arrived] arrived
   *[waiting] waiting
}
page-guiding-metres = { page-guiding } metres
page-metres = metres
page-no-scale = not known, so no distances are said
page-map-size = { $places ->
    [one] { $places } key frame
   *[other] { $places } key frames
}, { $points ->
    [one] { $points } landmark
   *[other] { $points } landmarks
}
page-map-empty = empty
page-time = { $clock }

## The page: pictures

page-own-label = What this camera sees
page-own-caption = This camera.
page-picture-label = What the guiding camera sees, with dots on what I recognise
page-picture-caption = What the guiding camera sees; dots are what I recognise.
page-map-title = Map and route
page-map-how = How to move the map
page-map-help = Arrow keys turn the view, with Shift they move it; W, A, S and D go through it, Q and E go down and up, plus and minus change its size, 0 shows all.
page-map-follow = Follow the camera
page-map-colour = Colours
page-map-height = by height
page-map-age = by age
page-map-normal = by direction
page-map-low = low
page-map-high = high
page-map-old = old
page-map-new = new
page-map-down = faces down
page-map-up = faces up
page-map-surface-show = Show the surface
page-map-points-show = Show points
page-map-columns-show = Show free and occupied space
page-map-path = path of the camera
page-map-recorded = recorded route
page-map-plan = cleaned route
page-map-loops = places seen again
page-map-eye = camera
page-map-bar = { $length } m
page-map-bar-units = { $length }
page-map-grid = A square of the grid is { $length } m wide.
page-map-grid-units = A square of the grid is { $length } units of unknown length wide.
page-no-map = There is no map yet.
page-map-words = A map of { $places ->
    [one] { $places } place
   *[other] { $places } places
} and { $points ->
    [one] { $points } point
   *[other] { $points } points
}.
page-map-surface = The surface is about { $area ->
    [one] { $area } square metre
   *[other] { $area } square metres
} large.
page-map-route = The recorded route is { $metres ->
    [one] { $metres } metre
   *[other] { $metres } metres
} long.
page-map-walker = { $percent } percent of the route is done.

## The page: settings

page-language = Language
page-told = How directions are given
page-told-voice = by this page's own voice
page-told-reader = by my screen reader
page-told-silent = by text and vibration only
page-unit = Distances in
page-unit-metres = metres
page-unit-feet = feet
page-unit-steps = steps
page-step = Length of a step in centimetres
page-directions = Directions
page-directions-words = left and right
page-directions-clock = like a clock, "to 2 o'clock"
page-directions-degrees = in degrees
page-speed = Words per minute
page-volume = Volume
page-sounds = Short sounds with the words
page-media = Headset and lock-screen buttons: play says it again, stop ends guidance
page-vibration = Vibration
page-keys = Single keys give commands: { $keys }
page-dark = Make the screen dark
page-dark-title = The screen is dark to save power. Guidance continues.
page-light = Make the screen light

## The page: the engine in this device

page-here = Everything is computed on this device; no picture leaves it.
page-here-stored = Everything is stored here: no network is needed any more.
page-here-failed = The guide has failed.
page-here-failed-stop = Stop. The guide has failed and begins again.
page-here-too-old = I cannot run in this browser. Update the browser, or use Cairn with a computer.
page-here-twice = Cairn is open in another tab of this browser. Close that one, then open this page again.
page-here-turned = The picture has another shape now. Hold the phone as before.
page-here-not-kept = What is recorded cannot be stored in this browser. Make room, and do not use a private window.
page-demo = Watch a demo: a simulated person is guided
page-demo-leave = Leave the demo
page-demo-start = Start the demo
page-demo-off = In this demo a simulated person goes out, and comes back by these words alone. Press Start the demo.
page-demo-failed = The demo does not start. It needs the network once; load the page again.
page-demo-ended = The demo has ended. The person stands { $metres } metres from the start.
page-files = Routes as files
page-files-why = Routes and maps are kept in this browser alone. As files they can be kept elsewhere, opened on a computer, and taken in again.
page-export = Save routes and maps as a file
page-exported = Routes and maps are saved as { $file }.
page-import = Take in routes and maps
page-import-replaces = The files replace all routes and maps that are kept here, and I begin anew.
page-import-no = Keep what is here
page-import-choose = Choose files
page-import-wrong = { $file } is no file of Cairn with routes and maps. Nothing was changed.
page-imported = { $count ->
    [one] { $count } file was taken in.
   *[other] { $count } files were taken in.
}

## The page: trust in this computer

page-trust = Trust this computer
page-trust-why = A phone connects best to a computer that it trusts. An iPhone needs it for the fast connection; without it the page uses a slower one. Once is enough.
page-trust-slow = Connected by the slower way: the browser refuses the fast one, usually because it does not trust this computer's certificate.
page-trust-how = { page-trust-slow } Below, Trust this computer says what to do.
page-trust-say = Read these steps aloud
page-trust-ios = iPhone and iPad:
page-trust-ios-get = Get the profile with Safari, and choose Allow.
page-trust-ios-install = Open Settings, choose Profile Downloaded, and install it.
page-trust-ios-on = In Settings, open General, About, Certificate Trust Settings, and turn on { $name }.
page-trust-android = Android:
page-trust-android-get = Get the certificate.
page-trust-android-install = Open Settings, search for "CA certificate", choose Install anyway, and choose the file.
page-trust-open = Open the page again.
page-trust-profile = Get the profile
page-trust-certificate = Get the certificate
page-trust-compare = Before you trust it, compare: the phone's details of { $name } and the terminal of the computer must show the same SHA-256 fingerprint, { $fingerprint }.
page-trust-not-local = An address of this computer is not one of a local network: this authority cannot stand for it, and phones will not trust the page there.
