use crate::document::{Limit, Table, Value, nearest};
use crate::routing::{Filter, Ids, Limits, Rules, Selection};
use crate::wire;

/// Reads what a link takes, what it is sent, and which links are its equals.
pub(super) fn rules(t: &mut Table<'_>) -> Rules {
    let group = t.get("group").and_then(|v| v.text()).map(str::to_owned);
    let inward = t.section("in", filter);
    let (outward, limits) = t.section("out", |t| (filter(t), t.section("limit_hz", limits)));
    Rules { group, inward, outward, limits }
}

fn filter(t: &mut Table<'_>) -> Filter {
    Filter::new(t.section("allow", selection), t.section("block", selection))
}

fn selection(t: &mut Table<'_>) -> Selection {
    let messages = members(t, "message", |v| message(&v));
    let ids = |t: &mut Table<'_>, key| -> Ids {
        let id = |v: Value<'_>| v.integer(0..=255).and_then(|id| u8::try_from(id).ok());
        members(t, key, id).into_iter().collect()
    };
    let (systems, components) = (ids(t, "system"), ids(t, "component"));
    Selection::new(messages, systems, components)
}

fn members<T>(t: &mut Table<'_>, key: &'static str, read: impl Fn(Value<'_>) -> Option<T>) -> Vec<T> {
    t.get(key).and_then(|v| v.list()).unwrap_or_default().into_iter().filter_map(read).collect()
}

/// A message by its name or its number.
fn message(v: &Value<'_>) -> Option<u32> {
    if !v.is_text() {
        return v.integer(0..=0xFF_FFFF).and_then(|id| u32::try_from(id).ok());
    }
    let name = v.text()?;
    let found = id_of(name);
    if found.is_none() {
        let near = nearest(name, wire::messages().map(|(_, info)| info.name));
        let advice = near.map_or_else(|| "its number works too".to_owned(), |near| format!("did you mean {near}?"));
        v.problem(format!("names no message: \"{name}\""), &advice);
    }
    found
}

fn id_of(name: &str) -> Option<u32> {
    wire::messages().find(|(_, info)| info.name == name).map(|(id, _)| id)
}

fn limits(t: &mut Table<'_>) -> Limits {
    let message = |key: &str| id_of(key).or_else(|| key.parse().ok().filter(|id| *id <= 0xFF_FFFF));
    let rates = t.take_matching(message).into_iter();
    Limits::new(rates.filter_map(|(id, v)| Some((id, v.number(Limit::Within(0.0, 10_000.0))?))))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::document::Document;
    use crate::wire::Encoder;
    use crate::wire::dialect::ardupilotmega::{ATTITUDE_DATA, HEARTBEAT_DATA};

    fn read(source: &str) -> Result<Rules, Vec<String>> {
        let document = Document::new("c.toml", source);
        document
            .read(|t| Some(rules(t)))
            .map(|(rules, _)| rules)
            .map_err(|issues| issues.iter().map(|i| format!("{} ({})", i.problem, i.advice)).collect())
    }

    #[test]
    fn messages_go_by_name_or_number() {
        let read = read(
            "group = 'radios'\n[in]\nallow.system = [1, 2]\n[out]\nblock.message = ['ATTITUDE', 0]\n\
             limit_hz.RAW_IMU = 2\nlimit_hz.27000 = 0.5\n",
        )
        .unwrap();
        assert_eq!(read.group.as_deref(), Some("radios"));
        let heartbeat = |system| Encoder::new(system, 1).encode(&HEARTBEAT_DATA::DEFAULT);
        assert!(read.inward.passes(heartbeat(2).as_ref()) && !read.inward.passes(heartbeat(3).as_ref()));
        assert!(!read.outward.passes(heartbeat(2).as_ref()));
        assert!(!read.outward.passes(Encoder::new(1, 1).encode(&ATTITUDE_DATA::DEFAULT).as_ref()));
        assert_eq!(read.limits, Limits::new([(27, 2.0), (27_000, 0.5)]));
    }

    #[test]
    fn mistakes_are_told() {
        let problems = read(
            "[in]\nalow.system = [1]\n[out]\nblock.message = ['ATTITUD']\nallow.component = [300]\n\
             limit_hz.HEARTBET = 1\n",
        )
        .unwrap_err();
        let expected =
            ["did you mean `allow`?", "did you mean ATTITUDE?", "between 0 and 255", "unknown key `HEARTBET`"];
        assert_eq!(problems.len(), expected.len(), "{problems:#?}");
        for expected in expected {
            assert!(problems.iter().any(|p| p.contains(expected)), "{expected}: {problems:#?}");
        }
    }
}
