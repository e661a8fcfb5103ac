//! What the fields of the parameters are, as given values and back. Ranges are not looked at: the shapes have
//! been checked before.

use std::collections::BTreeMap;

use super::choices::{
    ARTIFACT_NAMES, Correspondence, Embedding, GridChoice, Kinds, Landmarks, LatticeKind, Neighbors, Prune,
};
use super::given::Given;
use super::shape::label_of;

/// The type of a field.
pub(super) trait Field: Sized {
    /// It as it would be given; [`Field::read`] reads it back to the same.
    fn given(&self) -> Given;

    /// What was given; nothing for what the field cannot hold.
    fn read(given: &Given) -> Option<Self>;
}

impl Field for usize {
    fn given(&self) -> Given {
        Given::count(*self)
    }

    fn read(given: &Given) -> Option<Self> {
        given.as_whole()
    }
}

impl Field for f64 {
    fn given(&self) -> Given {
        Given::Number(*self)
    }

    fn read(given: &Given) -> Option<Self> {
        given.as_number()
    }
}

impl<T: Field> Field for Option<T> {
    fn given(&self) -> Given {
        self.as_ref().map_or(Given::Nothing, T::given)
    }

    fn read(given: &Given) -> Option<Self> {
        if *given == Given::Nothing { Some(None) } else { T::read(given).map(Some) }
    }
}

/// Labels.
impl Field for Vec<i64> {
    fn given(&self) -> Given {
        Given::List(self.iter().map(|label| Given::Whole(i128::from(*label))).collect())
    }

    fn read(given: &Given) -> Option<Self> {
        let Given::List(entries) = given else { return None };
        entries.iter().map(Given::as_whole).collect()
    }
}

/// Names of artifacts, in the order of the table whatever the order given: it means nothing.
impl Field for Vec<&'static str> {
    fn given(&self) -> Given {
        Given::List(self.iter().map(|name| Given::text(name)).collect())
    }

    fn read(given: &Given) -> Option<Self> {
        let Given::List(entries) = given else { return None };
        let mut names = ARTIFACT_NAMES.to_vec();
        names.retain(|name| entries.contains(&Given::text(name)));
        (names.len() == entries.len()).then_some(names)
    }
}

/// Texts by label, without the space around them.
impl Field for BTreeMap<i64, String> {
    fn given(&self) -> Given {
        Given::Object(self.iter().map(|(label, text)| (label.to_string(), Given::text(text))).collect())
    }

    fn read(given: &Given) -> Option<Self> {
        let Given::Object(entries) = given else { return None };
        let mut texts = Self::new();
        for (label, text) in entries {
            texts.insert(label_of(label)?, text.as_text()?.trim().to_owned());
        }
        Some(texts)
    }
}

impl Field for GridChoice {
    fn given(&self) -> Given {
        match *self {
            Self::Fixed { rows, cols } => Given::object([("rows", Given::count(rows)), ("cols", Given::count(cols))]),
            Self::Auto => Given::text("auto"),
        }
    }

    fn read(given: &Given) -> Option<Self> {
        match given {
            Given::Text(_) => Some(Self::Auto),
            _ => Some(Self::Fixed { rows: given.part("rows")?.as_whole()?, cols: given.part("cols")?.as_whole()? }),
        }
    }
}

impl Field for Neighbors {
    fn given(&self) -> Given {
        match *self {
            Self::Auto => Given::text("auto"),
            Self::Count(k) => Given::object([("k", Given::count(k))]),
            Self::RadiusMm(radius) => Given::object([("epsilon_mm", Given::Number(radius))]),
        }
    }

    fn read(given: &Given) -> Option<Self> {
        if let Given::Text(_) = given {
            return Some(Self::Auto);
        }
        match given.part("k") {
            Some(k) => k.as_whole().map(Self::Count),
            None => given.part("epsilon_mm")?.as_number().map(Self::RadiusMm),
        }
    }
}

impl Field for Landmarks {
    fn given(&self) -> Given {
        match *self {
            Self::Auto => Given::text("auto"),
            Self::All => Given::text("all"),
            Self::Count(count) => Given::count(count),
        }
    }

    fn read(given: &Given) -> Option<Self> {
        match given.as_text() {
            Some("all") => Some(Self::All),
            Some(_) => Some(Self::Auto),
            None => given.as_whole().map(Self::Count),
        }
    }
}

impl Field for Prune {
    fn given(&self) -> Given {
        match *self {
            Self::Auto => Given::text("auto"),
            Self::Strength(strength) => Given::Number(strength),
        }
    }

    fn read(given: &Given) -> Option<Self> {
        match given {
            Given::Text(_) => Some(Self::Auto),
            _ => given.as_number().map(Self::Strength),
        }
    }
}

impl Field for LatticeKind {
    fn given(&self) -> Given {
        Given::text(self.name())
    }

    fn read(given: &Given) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| given.as_text() == Some(kind.name()))
    }
}

impl Field for Correspondence {
    fn given(&self) -> Given {
        Given::text(self.name())
    }

    fn read(given: &Given) -> Option<Self> {
        Self::ALL.into_iter().find(|pairing| given.as_text() == Some(pairing.name()))
    }
}

impl Field for Kinds {
    fn given(&self) -> Given {
        match *self {
            Self::Auto => Given::text("auto"),
            Self::These { sheet, tube } => {
                let named = Self::NAMES.into_iter().zip([sheet, tube]).filter(|(_, is_in)| *is_in);
                Given::List(named.map(|(name, _)| Given::text(name)).collect())
            }
        }
    }

    fn read(given: &Given) -> Option<Self> {
        let Given::List(entries) = given else { return Some(Self::Auto) };
        let has = |name: &str| entries.iter().any(|entry| entry.as_text() == Some(name));
        Some(Self::These { sheet: has(Self::NAMES[0]), tube: has(Self::NAMES[1]) })
    }
}

impl Field for Embedding {
    fn given(&self) -> Given {
        Given::text(self.name())
    }

    fn read(given: &Given) -> Option<Self> {
        Self::ALL.into_iter().find(|embedding| given.as_text() == Some(embedding.name()))
    }
}
