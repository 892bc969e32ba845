/* What bindgen reads: the installed Embree 4 headers (never a copy) and our shim. */
#include <embree4/rtcore.h>
#include "shim.h"
