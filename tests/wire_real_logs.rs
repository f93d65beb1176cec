use mavobserver::wire::stats::LinkStats;
use mavobserver::wire::tlog::TlogReader;
use std::path::PathBuf;

#[test]
fn print() {
    let root = PathBuf::from("/work/shared/data");
    for dir in ["real", "sitl", "px4"] {
        let mut files: Vec<_> = std::fs::read_dir(root.join(dir)).unwrap().map(|e| e.unwrap().path()).collect();
        files.sort();
        for f in files {
            let t = std::time::Instant::now();
            let mut reader = match TlogReader::open(&f) {
                Ok(r) => r,
                Err(e) => { println!("{} {e}", f.display()); continue }
            };
            let mut stats = LinkStats::new();
            let mut reasons = std::collections::BTreeMap::<String, u32>::new();
            let mut last = 0;
            while let Some(r) = reader.next().unwrap() {
                last = r.received_unix_us.unwrap_or(last);
                stats.event(last, &r.event);
                if let mavobserver::wire::Event::Bad(b) = r.event { *reasons.entry(b.reason.to_string().split(':').next().unwrap().into()).or_default() += 1; }
                if let mavobserver::wire::Event::Frame(b) = r.event && b.message_name().is_none() { *reasons.entry(format!("unknown {}", b.message_id())).or_default() += 1; }
            }
            println!("{} {:?} {:?} bad {}/{} losses {:?} {:?}", f.file_name().unwrap().display(), reader.format(), stats.totals(), stats.bad_frames(), stats.bad_bytes(), stats.losses(), t.elapsed());
            for (s, x) in stats.sources() { println!("    {s} {:?} {:?}", x.totals(), x.losses()); }
            println!("    {reasons:?}");
        }
    }
}
