package application;

import static com.kuka.roboticsAPI.motionModel.BasicMotions.positionHold;

import com.kuka.connectivity.fastRobotInterface.ClientCommandMode;
import com.kuka.connectivity.fastRobotInterface.FRIConfiguration;
import com.kuka.connectivity.fastRobotInterface.FRIJointOverlay;
import com.kuka.connectivity.fastRobotInterface.FRISession;
import com.kuka.roboticsAPI.applicationModel.RoboticsAPIApplication;
import com.kuka.roboticsAPI.deviceModel.LBR;
import com.kuka.roboticsAPI.executionModel.CommandInvalidException;
import com.kuka.roboticsAPI.motionModel.controlModeModel.AbstractMotionControlMode;
import com.kuka.roboticsAPI.motionModel.controlModeModel.CartesianImpedanceControlMode;
import com.kuka.roboticsAPI.motionModel.controlModeModel.JointImpedanceControlMode;
import com.kuka.roboticsAPI.motionModel.controlModeModel.PositionControlMode;
import java.util.concurrent.TimeUnit;
import java.util.concurrent.TimeoutException;
import javax.inject.Inject;

/**
 * The program on the cabinet for cobot's backend "fri". It holds the arm and adds the commands of cobot as an overlay.
 *
 * For Sunrise.OS 1.11 to 1.17 with FRI 1.x. With FRI 2.x the imports are com.kuka.fri.FRIConfiguration,
 * FRIJointOverlay and FRISession, com.kuka.fri.common.ClientCommandMode, in which POSITION is called
 * JOINT_POSITION, and those of the new names of LBR and of the motions. See docs/kuka-fri.md.
 *
 * After a safety stop, a late client or a jump, the motion ends. The program then opens the next session and holds
 * the arm at its current position. cobot continues after a reset. Stop the program with the smartPAD.
 */
public class CobotFri extends RoboticsAPIApplication {
    /** Address of the computer with cobot, on the network of the controller's port for FRI. */
    private static final String COBOT = "192.170.10.3";
    /** robot.backend.port: FRI takes 30200 to 30209. */
    private static final int PORT = 30200;
    /** rt.period_s in milliseconds: 1, 2, 4, 5 or 10. */
    private static final int SEND_PERIOD_MS = 5;
    /** robot.backend.overlay: POSITION, TORQUE or WRENCH. */
    private static final ClientCommandMode OVERLAY = ClientCommandMode.POSITION;
    /** Stiffness with TORQUE and WRENCH. */
    private static final double STIFFNESS = 300.0;

    private static final long SESSION_S = 30;
    private static final long PAUSE_MS = 1000;

    @Inject
    private LBR lbr;

    private volatile boolean ended = false;

    @Override
    public void run() {
        while (!ended) {
            try {
                holdAndFollow();
            } catch (TimeoutException exc) {
                getLogger().warn("No client, or too slow a one: is cobot running, and its cable in the right port?");
            } catch (CommandInvalidException exc) {
                getLogger().warn("The motion has ended: " + exc.getMessage());
            }
            pause();
        }
    }

    @Override
    public void dispose() {
        ended = true;
        super.dispose();
    }

    /** One session. It ends with its motion, and only an error or the smartPAD ends the motion. */
    private void holdAndFollow() throws TimeoutException {
        FRISession session = new FRISession(configuration());
        try {
            session.await(SESSION_S, TimeUnit.SECONDS);
            getLogger().info("Session: " + session.getFRIChannelInformation());
            FRIJointOverlay overlay = new FRIJointOverlay(session, OVERLAY);
            lbr.move(positionHold(controlMode(), -1, TimeUnit.SECONDS).addMotionOverlay(overlay));
        } finally {
            session.close();
        }
    }

    private FRIConfiguration configuration() {
        FRIConfiguration configuration = FRIConfiguration.createRemoteConfiguration(lbr, COBOT);
        configuration.setSendPeriodMilliSec(SEND_PERIOD_MS);
        configuration.setReceiveMultiplier(1);
        configuration.setPortOnRemote(PORT);
        // Inputs and outputs that cobot sees by name; at most ten, set before the session is opened:
        // configuration.registerIO(flange.getInput("UserButton"));
        // configuration.registerIO(flange.getOutput("LEDBlue"));
        return configuration;
    }

    private AbstractMotionControlMode controlMode() {
        if (OVERLAY == ClientCommandMode.TORQUE) {
            JointImpedanceControlMode mode = new JointImpedanceControlMode(lbr.getJointCount());
            mode.setStiffnessForAllJoints(STIFFNESS);
            return mode;
        }
        if (OVERLAY == ClientCommandMode.WRENCH) {
            return new CartesianImpedanceControlMode();
        }
        return new PositionControlMode();
    }

    private void pause() {
        try {
            Thread.sleep(PAUSE_MS);
        } catch (InterruptedException exc) {
            ended = true;
        }
    }
}
