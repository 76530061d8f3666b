//! What option structs and their enums have alike: builder methods, one per field, so that a new field breaks no caller, and values by name.

macro_rules! setters {
    ($options:ty { $($field:ident: $kind:ty),* $(,)? }) => {
        impl $options {
            $(
                #[doc = concat!("The same with another `", stringify!($field), "`.")]
                #[must_use]
                pub fn $field(mut self, $field: $kind) -> Self {
                    self.$field = $field;
                    self
                }
            )*
        }
    };
}

/// Values of an enum by the names in its table `ALL`. Of any other name, the error is `$unknown` and `$known`, the names that there are.
macro_rules! by_name {
    ($kind:ty, $unknown:literal, $known:literal) => {
        impl std::str::FromStr for $kind {
            type Err = String;

            fn from_str(text: &str) -> Result<Self, Self::Err> {
                let known = Self::ALL.into_iter().find(|(name, _)| *name == text).map(|(_, value)| value);
                known.ok_or_else(|| format!(concat!($unknown, " `{}`; use ", $known), text))
            }
        }
    };
}
