/* Thrust feed-forward for a Crazyflie: an out-of-tree controller of its app layer that asks for less
   thrust where the ground gives more.

   Built as the firmware's own example of an out-of-tree controller, with `lift_model.h` (`nearlift
   export CAMPAIGN --c`) beside it and `-DGROUND=nearlift_<campaign>_ground`. Chosen in flight by the
   parameter stabilizer.controller. The thrust command is taken to be in proportion to lift far from
   every boundary. Nearer than measured, the header holds the nearest station's ratio. */

#include <stdbool.h>
#include <stdint.h>

#include "FreeRTOS.h"
#include "app.h"
#include "controller.h"
#include "controller_pid.h"
#include "lift_model.h"
#include "task.h"

#ifndef GROUND
#error "compile with -DGROUND=nearlift_<campaign>_ground"
#endif
/* Rotor plane above the floor where the estimate's z is 0: as the vehicle stands, by its feet. */
#ifndef STANDING_M
#define STANDING_M 0.024f
#endif

void appMain(void)
{
    while (1) {
        vTaskDelay(M2T(2000));
    }
}

void controllerOutOfTreeInit(void)
{
    controllerPidInit();
}

bool controllerOutOfTreeTest(void)
{
    return controllerPidTest();
}

void controllerOutOfTree(control_t *control, const setpoint_t *setpoint,
                         const sensorData_t *sensors, const state_t *state, const uint32_t tick)
{
    controllerPid(control, setpoint, sensors, state, tick);
    if (control->controlMode == controlModeLegacy) {
        /* an estimate that is no number gives the ratio 1 and the flag 2: the command stays */
        control->thrust /= GROUND(state->position.z + STANDING_M).ratio;
    }
}
