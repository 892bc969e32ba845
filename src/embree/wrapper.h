/* Input of bindgen: the installed Embree 4 headers (never a copy) and the shim. */
#include <embree4/rtcore.h>
#include "shim.h"
