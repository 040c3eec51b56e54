#include "nigh_forward.hpp"
