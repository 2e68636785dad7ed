//! A block on a plane, seen by textured views.

use super::*;
