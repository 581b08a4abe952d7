//! Runs robots with several seeds and prints a row for each: `robot [FIRST [COUNT]]`.

use cairn_trial::robot::{RobotConfig, Trial};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1).map(|a| a.parse::<u64>());
    let first = arguments.next().transpose()?.unwrap_or(1);
    let count = arguments.next().transpose()?.unwrap_or(1);
    for seed in first..first + count {
        let began = std::time::Instant::now();
        let end = Trial::new(RobotConfig::new(seed))?.run(|_| ())?;
        let goals: Vec<String> = end
            .goals
            .iter()
            .map(|g| {
                format!(
                    "{} {:.2} m {:.0} s {}",
                    g.state,
                    g.error_m,
                    g.seconds,
                    g.reason.as_deref().unwrap_or("")
                )
            })
            .collect();
        println!(
            "seed {seed}: {} collisions {:?}, clearance {:.2?}, explored {:.0} s, {:.0} s in all, {:.0} m, known {:.2}, error {:.3?}, lost {} coasted {} refused {}, loops {:?}, door {:?}, plans {}, goals {goals:?}, {:.1} s",
            end.collisions.len(),
            end.collisions.first(),
            end.clearance_m,
            end.explored_s,
            end.seconds,
            end.driven_m,
            end.known,
            end.position_error_m,
            end.lost,
            end.coasted,
            end.refused,
            end.loops,
            end.door_closed_s,
            end.plans,
            began.elapsed().as_secs_f64()
        );
        if count == 1 {
            for (t, at, cells) in &end.targets {
                println!("target {t:.1} {:.2} {:.2} {cells}", at.x, at.y);
            }
            for (t, state, reason) in &end.states {
                println!("{t:6.1} {state} {}", reason.as_deref().unwrap_or(""));
            }
            let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len().max(1) as f64;
            println!("step {:.1} ms, plan {:.1} ms", mean(&end.step_ms), mean(&end.plan_ms));
            for m in end.path.iter().step_by(50) {
                println!(
                    "at {:.0} s: off {:.3} m, {:.3} rad",
                    m.t_s,
                    (m.truth.translation - m.estimate.translation).norm(),
                    (m.truth.rotation.inverse() * m.estimate.rotation).log()
                );
            }
            if let Some(map) = &end.map {
                let truth: Vec<_> = end.path.iter().map(|m| m.truth.translation).collect();
                let estimate: Vec<_> = end.path.iter().map(|m| m.estimate.translation).collect();
                let colour = |v: i8| {
                    if v < 0 {
                        [200, 204, 210]
                    } else if v == 0 {
                        [250, 250, 247]
                    } else {
                        [40, 44, 52]
                    }
                };
                let picture = cairn_plan::picture::Picture::new(map, colour)
                    .points(&estimate, [240, 170, 60])
                    .points(&truth, [30, 90, 200]);
                std::fs::write("/tmp/robot.png", picture.png()?)?;
            }
        }
    }
    Ok(())
}
