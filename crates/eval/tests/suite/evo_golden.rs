//! Compares the evaluation with the output of evo 1.38.1 for the trajectories in `eval/` of the test data
//! (`tools/compare_with_evo.py --golden`), to 1e-6. Prints "skipped" where the data is missing.

use cairn_eval::{
    EvalError, EvalOptions, Evaluation, Statistics, evaluate_files, load_trajectory, parse_trajectory,
};
use std::path::PathBuf;

fn data(name: &str) -> PathBuf {
    let root = std::env::var_os("CAIRN_DATA").map_or_else(
        || PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data")),
        PathBuf::from,
    );
    root.join("eval").join(name)
}

fn files(pair: &str) -> (PathBuf, PathBuf) {
    let (reference, estimate) = match pair {
        "kitti00" => ("KITTI_00_gt.txt", "KITTI_00_ORB.txt"),
        "fr2_desk" => ("fr2_desk_groundtruth.txt", "fr2_desk_ORB.txt"),
        "fr2_desk_kf_mono" => ("fr2_desk_groundtruth.txt", "fr2_desk_ORB_kf_mono.txt"),
        "v102" => ("V102_groundtruth.csv", "V102.txt"),
        other => panic!("no pair {other}"),
    };
    (data(reference), data(estimate))
}

/// The evaluation options for the name of a metric.
fn options(align: &str, metric: &str) -> EvalOptions {
    let mut options = EvalOptions { align: align.parse().unwrap(), ..EvalOptions::default() };
    if let Some((_, delta)) = metric.split_once(", ") {
        let words: Vec<&str> = delta.split(' ').collect();
        let unit = if words[1].starts_with("frame") { "f" } else { words[1] };
        options.delta = format!("{}{unit}", words[0]).parse().unwrap();
        options.all_pairs = words.get(2) == Some(&"all");
    }
    options
}

fn statistics(result: &Evaluation, metric: &str) -> Statistics {
    match metric.split(',').next().unwrap() {
        "ate m" => result.ate_m,
        "ate deg" => result.ate_deg.unwrap(),
        "rpe m" => result.rpe_m.unwrap(),
        "rpe deg" => result.rpe_deg.unwrap(),
        other => panic!("no metric {other}"),
    }
}

#[test]
fn agrees_with_evo() {
    if !data("").is_dir() {
        println!("skipped: no folder {}", data("").display());
        return;
    }
    let mut worst = (0.0, String::new());
    for (pair, align, metric, count, golden) in GOLDEN {
        let (reference, estimate) = files(pair);
        let (reference, estimate) =
            (load_trajectory(&reference).unwrap(), load_trajectory(&estimate).unwrap());
        let result = evaluate_files(&reference, &estimate, &options(align, metric)).unwrap();
        let ours = statistics(&result, metric);
        let what = format!("{pair}, {align}, {metric}");
        assert_eq!(ours.count, *count, "{what}: count");
        let values = [ours.rmse, ours.mean, ours.median, ours.std, ours.min, ours.max];
        for ((name, value), expected) in
            ["rmse", "mean", "median", "std", "min", "max"].iter().zip(values).zip(golden)
        {
            let difference = (value - expected).abs();
            if difference > worst.0 {
                worst = (difference, format!("{what}, {name}: {value} against {expected}"));
            }
        }
    }
    println!("{} metrics, largest difference {:.2e} at {}", GOLDEN.len(), worst.0, worst.1);
    assert!(worst.0 < 1e-6, "{}", worst.1);
}

#[test]
fn reference_with_gap_or_positions_only() {
    if !data("").is_dir() {
        println!("skipped: no folder {}", data("").display());
        return;
    }
    let (reference, estimate) = files("fr2_desk");
    let (mut reference, estimate) =
        (load_trajectory(&reference).unwrap(), load_trajectory(&estimate).unwrap());
    let whole = evaluate_files(&reference, &estimate, &EvalOptions::default()).unwrap();
    assert!(whole.reference_covered > 0.95 && whole.notes.is_empty(), "coverage {}", whole.reference_covered);

    let n = reference.trajectory.len();
    let rest: Vec<usize> = (0..n / 4).chain(n / 2..n).collect();
    reference.trajectory = reference.trajectory.select(&rest).unwrap();
    let gap = evaluate_files(&reference, &estimate, &EvalOptions::default()).unwrap();
    assert!(gap.pairs < whole.pairs * 9 / 10 && gap.reference_covered > 0.95, "{} pairs", gap.pairs);

    reference.has_rotations = false;
    let positions = evaluate_files(&reference, &estimate, &EvalOptions::default()).unwrap();
    assert_eq!(positions.ate_m, gap.ate_m);
    assert_eq!((positions.ate_deg, positions.rpe_m), (None, None));
    assert!(positions.notes[0].contains("positions only"));
}

/// Poses along a curve, as lines of KITTI and of TUM.
fn curve(n: usize) -> (Vec<String>, Vec<String>) {
    let pose = |k: usize| {
        let a = 0.02 * k as f64;
        let (x, z) = (20.0 * (1.0 - a.cos()), 20.0 * a.sin());
        let kitti = format!("{c} 0 {s} {x} 0 1 0 0 {m} 0 {c} {z}", c = a.cos(), s = a.sin(), m = -a.sin());
        // 103.7 ms between frames: no step of a nominal clock.
        (kitti, format!("{} {x} 0 {z} 0 {} 0 {}", 0.1037 * k as f64, (0.5 * a).sin(), (0.5 * a).cos()))
    };
    (0..n).map(pose).unzip()
}

#[test]
fn poses_without_times_are_never_paired_by_chance() {
    let (kitti, tum) = curve(300);
    let parse = |lines: &[String], name: &str| parse_trajectory(&lines.join("\n"), name, None).unwrap();
    let options = EvalOptions::default();
    let truth = parse(&kitti, "truth");
    // Key frames only, and a run that lost its first frames or has some more.
    let key_frames: Vec<String> = kitti.iter().step_by(10).cloned().collect();
    let more = [kitti.clone(), kitti[..20].to_vec()].concat();
    for fewer in [&key_frames, &kitti[30..].to_vec(), &more] {
        let wrong = evaluate_files(&truth, &parse(fewer, "estimate"), &options).unwrap_err();
        assert!(matches!(wrong, EvalError::Counts { reference: 300, .. }), "{wrong}");
    }
    let numbered: Vec<String> =
        kitti.iter().enumerate().step_by(10).map(|(k, line)| format!("{k} {line}")).collect();
    let known = evaluate_files(&truth, &parse(&numbered, "numbered"), &options).unwrap();
    assert!(known.pairs == 30 && known.ate_m.rmse < 1e-9, "{known:?}");
    // Real times against none: in order where there are as many, else not at all.
    let timed = evaluate_files(&truth, &parse(&tum, "timed"), &options).unwrap();
    assert!(timed.pairs == 300 && timed.ate_m.rmse < 1e-9, "{timed:?}");
    assert!(timed.notes[0].contains("paired in order"), "{:?}", timed.notes);
    let some: Vec<String> = tum.iter().step_by(10).cloned().collect();
    for (reference, estimate) in [(&truth, &parse(&some, "some")), (&parse(&some, "some"), &truth)] {
        let wrong = evaluate_files(reference, estimate, &options).unwrap_err();
        assert!(matches!(wrong, EvalError::NoTimes { poses: 300, others: 30, .. }), "{wrong}");
    }
    // Times that are numbers of frames at the nominal rate are these numbers.
    let nominal = |line: &String| {
        let (time, pose) = line.split_once(' ').unwrap();
        format!("{:.1} {pose}", time.parse::<f64>().unwrap() / 1.037)
    };
    let nominal: Vec<String> = some.iter().map(nominal).collect();
    let found = evaluate_files(&truth, &parse(&nominal, "nominal"), &options).unwrap();
    assert!(found.pairs == 30 && found.ate_m.rmse < 1e-6, "{found:?}");
}

/// Pair, alignment, metric, number of values, and rmse, mean, median, std, min, max.
#[rustfmt::skip]
const GOLDEN: &[(&str, &str, &str, usize, [f64; 6])] = &[
    ("kitti00", "none", "ate m", 4541, [7.790288882657, 7.011750401667, 6.801631674560, 3.394695447308, 4.000000055511e-09, 13.458508807382]),
    ("kitti00", "none", "ate deg", 4541, [1.609558710630, 1.538165059974, 1.518558229398, 0.474054312541, 3.768164354099e-15, 7.936409654954]),
    ("kitti00", "none", "rpe m, 1 frame", 4540, [0.028120377017, 0.019301310981, 0.014709043439, 0.020450305572, 0.000312400263, 0.302712490595]),
    ("kitti00", "none", "rpe deg, 1 frame", 4540, [0.114973521260, 0.059583454923, 0.041074405275, 0.098329662312, 0.002243553776, 2.196615406942]),
    ("kitti00", "none", "rpe m, 10 frames all", 4531, [0.189348230386, 0.139782268495, 0.113219491692, 0.127724977058, 0.004600557887, 1.515383270547]),
    ("kitti00", "none", "rpe m, 1 m", 2718, [0.046200726197, 0.027810877560, 0.020383034333, 0.036892576360, 0.001955312358, 0.629549800403]),
    ("kitti00", "none", "rpe deg, 1 m", 2718, [0.192440487176, 0.076351726272, 0.047320990740, 0.176645846257, 0.002487119464, 3.865579724850]),
    ("kitti00", "none", "rpe m, 5 m all", 4469, [0.158083428968, 0.100230588290, 0.071368553190, 0.122246471054, 0.006934927027, 1.392705002477]),
    ("kitti00", "se3", "ate m", 4541, [1.303449714565, 1.156997128539, 1.065624769556, 0.600282269397, 0.069313220215, 3.587949120679]),
    ("kitti00", "se3", "ate deg", 4541, [0.756300516635, 0.616516410542, 0.527891364130, 0.438061624654, 0.112819536434, 6.752584453656]),
    ("kitti00", "se3", "rpe m, 1 frame", 4540, [0.028120377017, 0.019301310981, 0.014709043439, 0.020450305572, 0.000312400263, 0.302712490595]),
    ("kitti00", "se3", "rpe deg, 1 frame", 4540, [0.114973521260, 0.059583454923, 0.041074405275, 0.098329662312, 0.002243553776, 2.196615406942]),
    ("kitti00", "se3", "rpe m, 10 frames all", 4531, [0.189348230386, 0.139782268495, 0.113219491692, 0.127724977058, 0.004600557887, 1.515383270547]),
    ("kitti00", "se3", "rpe m, 1 m", 2718, [0.046200726197, 0.027810877560, 0.020383034333, 0.036892576360, 0.001955312358, 0.629549800403]),
    ("kitti00", "se3", "rpe deg, 1 m", 2718, [0.192440487176, 0.076351726272, 0.047320990740, 0.176645846257, 0.002487119464, 3.865579724850]),
    ("kitti00", "se3", "rpe m, 5 m all", 4469, [0.158083428968, 0.100230588290, 0.071368553190, 0.122246471054, 0.006934927027, 1.392705002477]),
    ("kitti00", "sim3", "ate m", 4541, [0.937709073611, 0.872692631969, 0.844691013486, 0.343082900827, 0.179514666880, 2.693499863613]),
    ("kitti00", "sim3", "ate deg", 4541, [0.756300516635, 0.616516410542, 0.527891364130, 0.438061624654, 0.112819536434, 6.752584453656]),
    ("kitti00", "sim3", "rpe m, 1 frame", 4540, [0.027822453344, 0.018952973985, 0.014375695517, 0.020368448325, 0.000235753892, 0.304399846612]),
    ("kitti00", "sim3", "rpe deg, 1 frame", 4540, [0.114973521260, 0.059583454923, 0.041074405275, 0.098329662312, 0.002243553776, 2.196615406942]),
    ("kitti00", "sim3", "rpe m, 10 frames all", 4531, [0.184809917980, 0.134330882373, 0.109991287999, 0.126924858970, 0.001393248914, 1.507732628254]),
    ("kitti00", "sim3", "rpe m, 1 m", 2731, [0.045130859234, 0.026997273548, 0.019586475823, 0.036165476303, 0.001791643852, 0.631954952900]),
    ("kitti00", "sim3", "rpe deg, 1 m", 2731, [0.191240636741, 0.076236266301, 0.047114256324, 0.175388177599, 0.002487119464, 3.865579724850]),
    ("kitti00", "sim3", "rpe m, 5 m all", 4474, [0.155425418147, 0.096846889072, 0.067666559121, 0.121563730954, 0.002486031939, 1.384730322149]),
    ("fr2_desk", "none", "ate m", 2174, [3.173993541902, 2.949693887599, 2.594642464975, 1.171981643839, 1.460344283364, 5.066735062280]),
    ("fr2_desk", "none", "ate deg", 2174, [132.478584406818, 132.477169431072, 132.453930851348, 0.612295651901, 130.889668974414, 134.516178785027]),
    ("fr2_desk", "none", "rpe m, 1 frame", 2173, [0.003490321375, 0.003038087418, 0.002750288386, 0.001718245658, 0.000131969006, 0.019484678920]),
    ("fr2_desk", "none", "rpe deg, 1 frame", 2173, [0.280519226267, 0.229556119581, 0.187818457119, 0.161229725140, 0.006038945920, 1.259403502708]),
    ("fr2_desk", "none", "rpe m, 10 frames all", 2164, [0.005841796674, 0.005176504927, 0.004701707907, 0.002707468396, 0.000491053494, 0.021287541537]),
    ("fr2_desk", "none", "rpe m, 1 m", 19, [0.011671538091, 0.010632208677, 0.009943713388, 0.004814658873, 0.003107052792, 0.021934022368]),
    ("fr2_desk", "none", "rpe deg, 1 m", 19, [0.687341143055, 0.602166563499, 0.512361434191, 0.331411038953, 0.242842557351, 1.470901758371]),
    ("fr2_desk", "none", "rpe m, 5 m all", 1523, [0.034134662882, 0.032222737864, 0.030256119976, 0.011263675004, 0.002979604044, 0.076081009088]),
    ("fr2_desk", "se3", "ate m", 2174, [0.008118977562, 0.007491776870, 0.007414629829, 0.003129069507, 0.000349636198, 0.024299593694]),
    ("fr2_desk", "se3", "ate deg", 2174, [0.989035658368, 0.959473081702, 0.949801238033, 0.240006122867, 0.132950517036, 2.024871216461]),
    ("fr2_desk", "se3", "rpe m, 1 frame", 2173, [0.003490321375, 0.003038087418, 0.002750288386, 0.001718245658, 0.000131969006, 0.019484678920]),
    ("fr2_desk", "se3", "rpe deg, 1 frame", 2173, [0.280519226267, 0.229556119581, 0.187818457119, 0.161229725140, 0.006038945920, 1.259403502708]),
    ("fr2_desk", "se3", "rpe m, 10 frames all", 2164, [0.005841796674, 0.005176504927, 0.004701707907, 0.002707468396, 0.000491053494, 0.021287541537]),
    ("fr2_desk", "se3", "rpe m, 1 m", 19, [0.011671538091, 0.010632208677, 0.009943713388, 0.004814658873, 0.003107052792, 0.021934022368]),
    ("fr2_desk", "se3", "rpe deg, 1 m", 19, [0.687341143055, 0.602166563499, 0.512361434191, 0.331411038953, 0.242842557351, 1.470901758371]),
    ("fr2_desk", "se3", "rpe m, 5 m all", 1523, [0.034134662882, 0.032222737864, 0.030256119976, 0.011263675004, 0.002979604044, 0.076081009088]),
    ("fr2_desk", "sim3", "ate m", 2174, [0.006123163030, 0.005586197319, 0.005305225076, 0.002507493771, 0.000189795810, 0.021476785563]),
    ("fr2_desk", "sim3", "ate deg", 2174, [0.989035658368, 0.959473081702, 0.949801238033, 0.240006122867, 0.132950517036, 2.024871216461]),
    ("fr2_desk", "sim3", "rpe m, 1 frame", 2173, [0.003485016891, 0.003030383000, 0.002745520871, 0.001721081522, 0.000139443933, 0.020907743941]),
    ("fr2_desk", "sim3", "rpe deg, 1 frame", 2173, [0.280519226267, 0.229556119581, 0.187818457119, 0.161229725140, 0.006038945920, 1.259403502708]),
    ("fr2_desk", "sim3", "rpe m, 10 frames all", 2164, [0.005844447421, 0.005166745191, 0.004683729186, 0.002731722861, 0.000481393475, 0.022171985786]),
    ("fr2_desk", "sim3", "rpe m, 1 m", 18, [0.013191686137, 0.011727092847, 0.010722241157, 0.006041181714, 0.002865873025, 0.026626872776]),
    ("fr2_desk", "sim3", "rpe deg, 1 m", 18, [0.740940398934, 0.663327415945, 0.560706521877, 0.330135448005, 0.251611207203, 1.552156417557]),
    ("fr2_desk", "sim3", "rpe m, 5 m all", 1522, [0.033218467438, 0.031172644851, 0.029769656329, 0.011477490662, 0.004429877520, 0.082016903387]),
    ("fr2_desk_kf_mono", "none", "ate m", 118, [2.373882904791, 2.268699329399, 2.415295317234, 0.698801401289, 0.907645710887, 3.377261086167]),
    ("fr2_desk_kf_mono", "none", "ate deg", 118, [119.049754328752, 119.048858970248, 119.016341744484, 0.461718115765, 118.137776130641, 120.109453004320]),
    ("fr2_desk_kf_mono", "none", "rpe m, 1 frame", 117, [0.136725557317, 0.073579715798, 0.040577855023, 0.115238463399, 0.004107891239, 1.122442423654]),
    ("fr2_desk_kf_mono", "none", "rpe deg, 1 frame", 117, [0.387091383250, 0.337642180352, 0.303958871760, 0.189307942341, 0.054242023854, 0.983128570464]),
    ("fr2_desk_kf_mono", "none", "rpe m, 10 frames all", 108, [0.643646652400, 0.574667406442, 0.481692504609, 0.289893747982, 0.111707480415, 1.593800960970]),
    ("fr2_desk_kf_mono", "none", "rpe m, 1 m", 6, [1.071567199352, 1.023181986333, 0.937164907668, 0.318362820647, 0.692007505430, 1.682343065085]),
    ("fr2_desk_kf_mono", "none", "rpe deg, 1 m", 6, [1.216324537635, 1.103002663236, 1.171577883701, 0.512669977420, 0.376228963994, 1.734268980765]),
    ("fr2_desk_kf_mono", "none", "rpe m, 5 m all", 26, [1.425072160543, 1.416920198644, 1.465285806426, 0.152209767854, 1.197027025756, 1.620549204782]),
    ("fr2_desk_kf_mono", "se3", "ate m", 118, [0.939049262834, 0.916990876212, 0.921213001212, 0.202339444930, 0.531600052287, 1.411524442034]),
    ("fr2_desk_kf_mono", "se3", "ate deg", 118, [0.899055746937, 0.864405107803, 0.856042831598, 0.247194348043, 0.196801407906, 1.372715757173]),
    ("fr2_desk_kf_mono", "se3", "rpe m, 1 frame", 117, [0.136725557317, 0.073579715798, 0.040577855023, 0.115238463399, 0.004107891239, 1.122442423654]),
    ("fr2_desk_kf_mono", "se3", "rpe deg, 1 frame", 117, [0.387091383250, 0.337642180352, 0.303958871760, 0.189307942341, 0.054242023854, 0.983128570464]),
    ("fr2_desk_kf_mono", "se3", "rpe m, 10 frames all", 108, [0.643646652400, 0.574667406442, 0.481692504609, 0.289893747982, 0.111707480415, 1.593800960970]),
    ("fr2_desk_kf_mono", "se3", "rpe m, 1 m", 6, [1.071567199352, 1.023181986333, 0.937164907668, 0.318362820647, 0.692007505430, 1.682343065085]),
    ("fr2_desk_kf_mono", "se3", "rpe deg, 1 m", 6, [1.216324537635, 1.103002663236, 1.171577883701, 0.512669977420, 0.376228963994, 1.734268980765]),
    ("fr2_desk_kf_mono", "se3", "rpe m, 5 m all", 26, [1.425072160543, 1.416920198644, 1.465285806426, 0.152209767854, 1.197027025756, 1.620549204782]),
    ("fr2_desk_kf_mono", "sim3", "ate m", 118, [0.007729264783, 0.007103615952, 0.007099822211, 0.003046337884, 0.001216359698, 0.015688557595]),
    ("fr2_desk_kf_mono", "sim3", "ate deg", 118, [0.899055746937, 0.864405107803, 0.856042831598, 0.247194348043, 0.196801407906, 1.372715757173]),
    ("fr2_desk_kf_mono", "sim3", "rpe m, 1 frame", 117, [0.007069324681, 0.005698826112, 0.004931194321, 0.004183148622, 0.000570140246, 0.035902583752]),
    ("fr2_desk_kf_mono", "sim3", "rpe deg, 1 frame", 117, [0.387091383250, 0.337642180352, 0.303958871760, 0.189307942341, 0.054242023854, 0.983128570464]),
    ("fr2_desk_kf_mono", "sim3", "rpe m, 10 frames all", 108, [0.017095379463, 0.015182546994, 0.013784048398, 0.007857624690, 0.002846132942, 0.048569721057]),
    ("fr2_desk_kf_mono", "sim3", "rpe m, 1 m", 12, [0.019771481442, 0.017609495344, 0.015077493447, 0.008989836045, 0.009101027058, 0.043380411654]),
    ("fr2_desk_kf_mono", "sim3", "rpe deg, 1 m", 12, [0.668259566371, 0.618119525695, 0.499028336055, 0.253966730106, 0.345077381201, 1.086256243179]),
    ("fr2_desk_kf_mono", "sim3", "rpe m, 5 m all", 69, [0.034236107415, 0.032315292997, 0.033413418525, 0.011306320772, 0.006769947158, 0.061171870807]),
    ("v102", "none", "ate m", 798, [2.554174046218, 2.507287888464, 2.377860678158, 0.487147311123, 1.752105426168, 3.655152031812]),
    ("v102", "none", "ate deg", 798, [27.815578896381, 27.728002363522, 28.240866125303, 2.205519047596, 17.668820977191, 31.153172847564]),
    ("v102", "none", "rpe m, 1 frame", 797, [0.015076710160, 0.006106922465, 0.004183939336, 0.013784508959, 0.000114695027, 0.217408924427]),
    ("v102", "none", "rpe deg, 1 frame", 797, [0.357615594886, 0.089875600748, 0.033030032512, 0.346137675060, 0.003067746633, 4.939154960255]),
    ("v102", "none", "rpe m, 10 frames all", 788, [0.055675040133, 0.043945401680, 0.036252234351, 0.034183501356, 0.000611951132, 0.221219839884]),
    ("v102", "none", "rpe m, 1 m", 72, [0.060283866083, 0.047425672356, 0.035772824700, 0.037214917862, 0.009379413105, 0.245869569989]),
    ("v102", "none", "rpe deg, 1 m", 72, [1.566417332138, 0.635210074958, 0.230992996610, 1.431841967221, 0.020229815348, 9.716721047163]),
    ("v102", "none", "rpe m, 5 m all", 717, [0.113088782073, 0.098725140271, 0.087996863071, 0.055158130038, 0.014766689495, 0.376681835552]),
    ("v102", "se3", "ate m", 798, [0.091727115207, 0.081521621946, 0.077911949019, 0.042048648247, 0.002619987097, 0.255816733814]),
    ("v102", "se3", "ate deg", 798, [2.716771360278, 2.308505340844, 1.954712391162, 1.432358096051, 0.221063365719, 9.911251434937]),
    ("v102", "se3", "rpe m, 1 frame", 797, [0.015076710160, 0.006106922465, 0.004183939336, 0.013784508959, 0.000114695027, 0.217408924427]),
    ("v102", "se3", "rpe deg, 1 frame", 797, [0.357615594886, 0.089875600748, 0.033030032512, 0.346137675060, 0.003067746633, 4.939154960255]),
    ("v102", "se3", "rpe m, 10 frames all", 788, [0.055675040133, 0.043945401680, 0.036252234351, 0.034183501356, 0.000611951132, 0.221219839884]),
    ("v102", "se3", "rpe m, 1 m", 72, [0.060283866083, 0.047425672356, 0.035772824700, 0.037214917862, 0.009379413105, 0.245869569989]),
    ("v102", "se3", "rpe deg, 1 m", 72, [1.566417332138, 0.635210074958, 0.230992996610, 1.431841967221, 0.020229815348, 9.716721047163]),
    ("v102", "se3", "rpe m, 5 m all", 717, [0.113088782073, 0.098725140271, 0.087996863071, 0.055158130038, 0.014766689495, 0.376681835552]),
    ("v102", "sim3", "ate m", 798, [0.083841388043, 0.074841084783, 0.071945178666, 0.037791406133, 0.007000290579, 0.226651792383]),
    ("v102", "sim3", "ate deg", 798, [2.716771360278, 2.308505340844, 1.954712391162, 1.432358096051, 0.221063365719, 9.911251434937]),
    ("v102", "sim3", "rpe m, 1 frame", 797, [0.014710654642, 0.006022701518, 0.004358350918, 0.013421267691, 0.000109160190, 0.213029091382]),
    ("v102", "sim3", "rpe deg, 1 frame", 797, [0.357615594886, 0.089875600748, 0.033030032512, 0.346137675060, 0.003067746633, 4.939154960255]),
    ("v102", "sim3", "rpe m, 10 frames all", 788, [0.053806522941, 0.042289240364, 0.034469512647, 0.033268033612, 0.001946804151, 0.217471477700]),
    ("v102", "sim3", "rpe m, 1 m", 71, [0.058260823696, 0.046114413618, 0.034930249893, 0.035605960657, 0.014320511254, 0.246258063553]),
    ("v102", "sim3", "rpe deg, 1 m", 71, [1.572717442203, 0.651516239515, 0.242106405073, 1.431421231734, 0.024670730438, 9.572219162655]),
    ("v102", "sim3", "rpe m, 5 m all", 715, [0.113329882145, 0.096900484444, 0.086165339966, 0.058770386263, 0.002716895377, 0.374083267970]),
];
