//! `--team`: sharing the map while the run goes on.

use super::arguments::Arguments;
use crate::commands::team::join::Sharing;
use crate::failure::Failure;
use crate::outputs::Outputs;

/// Begins to share the map with the team, where --team asks for it.
///
/// # Errors
/// When an option is missing, or as [`Sharing::begin`].
pub fn begin(a: &Arguments, outputs: &Outputs) -> Result<Option<Sharing>, Failure> {
    let Some(team) = &a.team else {
        let given = !a.reach.peer.is_empty()
            || a.reach.listen.is_some()
            || a.reach.secret.is_some()
            || a.reach.send_limit.is_some();
        let options = "--peer, --listen, --secret and --send-limit";
        return match given {
            true => Err(Failure::usage(options, "need --team", "add --team NAME")),
            false => Ok(None),
        };
    };
    match (a.robot, outputs.file("--map-out"), outputs.file("--team-map")) {
        (Some(robot), Some(map), Some(out)) => Sharing::begin(robot, team, &a.reach, map, out).map(Some),
        _ => Err(Failure::usage("--team", "needs --robot, --map-out and --team-map", "add them")),
    }
}
