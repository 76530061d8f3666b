//! The data model and the one loop: columns, spaces, seeds, environments, policies, World, evaluation.
