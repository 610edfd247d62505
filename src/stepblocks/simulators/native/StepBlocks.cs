// Unity component for libstepblocks: put libstepblocks.so, stepblocks.dll or libstepblocks.dylib
// into Assets/Plugins, blocks.txt into Assets/StreamingAssets, and this file anywhere under Assets.
//
// Unity's frames are too slow and too uneven for a servo: the loop runs in a thread of its own at
// `rate`, reads your device through `ReadHand` and gives the force to `WriteForce`. What the scene
// shows (`Tip`, `Pull`, `Ring`, `Releases`) is a copy of the last tick.
//
// Axes: Unity is left-handed with y up. A part's (x, y, z) is Unity's (-x, z, -y); metres in both.
//
// A script of yours beside it, on the same object, joins it to a device:
//
//     using StepBlocksUnity;
//     using UnityEngine;
//
//     public class MyHand : MonoBehaviour
//     {
//         public StepBlocks haptics;  // drag the component here
//
//         void Awake()
//         {
//             haptics.ReadHand = (position, velocity) => { /* your device's, [m] and [m/s] */ };
//             haptics.WriteForce = (x, y, z) => { /* to your device, [N] */ };
//         }
//
//         void Update()
//         {
//             if (Input.GetKeyDown(KeyCode.Alpha5)) haptics.Choose("step-050");
//             transform.position = haptics.Tip;
//         }
//     }
using System;
using System.Diagnostics;
using System.Runtime.InteropServices;
using System.Threading;
using UnityEngine;

namespace StepBlocksUnity
{
    [StructLayout(LayoutKind.Sequential)]
    public struct Output
    {
        public double forceX, forceY, forceZ;
        public double ring, pull, load;
        public double tipX, tipY, tipZ;
        public double releaseForce, releaseEnergy;
        public uint events, faults, limited, late;
        public int block, touching, state, reserved;
    }

    public enum Parameter
    {
        TipRadius,
        Load,
        Friction,
        Stiffness,
        Wall,
        Conversion,
        Frequency,
        Decay,
        Damping,
        Scale,
        PullLimit
    }

    public enum Setting { ForceLimit, Ramp, Rise, Watchdog, Vibration, Jump }

    public static class Native
    {
        const string Library = "stepblocks";
        public const int AbiVersion = 1;

        [DllImport(Library)] public static extern int sb_abi_version();
        [DllImport(Library)] public static extern IntPtr sb_create();
        [DllImport(Library)] public static extern void sb_destroy(IntPtr world);
        [DllImport(Library)] public static extern IntPtr sb_message(IntPtr world);
        [DllImport(Library)] public static extern int sb_load(IntPtr world, byte[] path);
        [DllImport(Library)] public static extern int sb_count(IntPtr world);
        [DllImport(Library)] public static extern int sb_find(IntPtr world, byte[] name);
        [DllImport(Library)]
        public static extern int sb_set(IntPtr world, int block, int parameter, double value);
        [DllImport(Library)]
        public static extern int sb_configure(IntPtr world, int setting, double value);
        [DllImport(Library)] public static extern int sb_choose(IntPtr world, int block);
        [DllImport(Library)]
        public static extern int sb_tick(
            IntPtr world, double[] hand, double[] velocity, double dt, out Output output);
        [DllImport(Library)]
        public static extern int sb_tick_tooth(
            IntPtr world, double[] hand, double[] velocity, double dt, out Output output);

        /// <summary>A text as C takes it: UTF-8 with a zero at its end.</summary>
        public static byte[] Text(string text)
        {
            return System.Text.Encoding.UTF8.GetBytes(text + "\0");
        }

        /// <summary>A text of C, which is UTF-8 up to a zero.</summary>
        public static string Read(IntPtr text)
        {
            int length = 0;
            while (Marshal.ReadByte(text, length) != 0) ++length;
            byte[] bytes = new byte[length];
            Marshal.Copy(text, bytes, 0, length);
            return System.Text.Encoding.UTF8.GetString(bytes);
        }
    }

    /// <summary>One hand on the blocks of a file.</summary>
    public sealed class StepBlocks : MonoBehaviour
    {
        [Tooltip("File of blocks in StreamingAssets")] public string blocks = "blocks.txt";
        [Tooltip("Name of the block to begin with; empty for the first")] public string block = "";
        [Tooltip("Ticks per second")] public double rate = 1000.0;
        [Tooltip("Largest force that the device may render [N]; below zero that of the file")]
        public double forceLimit = -1.0;
        [Tooltip("In which the force grows after the start [s]")] public double rise = 1.0;
        public bool vibration = true;
        [Tooltip("The file is a whole tooth: hand and force are in the axes of the scan")]
        public bool tooth = false;

        /// <summary>Reads position [m] and velocity [m/s] of the hand in the axes of the part; set
        /// it before Start.</summary>
        public Action<double[], double[]> ReadHand;

        /// <summary>Gives a force [N] in the axes of the part to the device; set it before
        /// Start.</summary>
        public Action<double, double, double> WriteForce;

        /// <summary>Gives the time [s] in place of a stopwatch, as for a run without a device; set
        /// it before Start.</summary>
        public Func<double> Seconds;

        readonly object gate = new object();
        IntPtr world = IntPtr.Zero;
        Thread servo;
        volatile bool running;
        int wanted = -1;
        Output shown;

        public Vector3 Tip
        {
            get
            {
                Output now = Shown;
                return ToUnity(now.tipX, now.tipY, now.tipZ);
            }
        }

        public double Pull => Shown.pull;
        public double Ring => Shown.ring;
        public double ReleaseForce => Shown.releaseForce;
        public uint Releases => Shown.events;

        // The last tick, whole
        Output Shown
        {
            get
            {
                lock (gate) return shown;
            }
        }

        public static Vector3 ToUnity(double x, double y, double z)
        {
            return new Vector3((float)-x, (float)z, (float)-y);
        }

        void Start()
        {
            if (Native.sb_abi_version() != Native.AbiVersion)
                throw new InvalidOperationException("the native library is of another version");
            world = Native.sb_create();
            string path = System.IO.Path.Combine(Application.streamingAssetsPath, blocks);
            Check(Native.sb_load(world, Native.Text(path)));
            if (forceLimit >= 0.0)
                Check(Native.sb_configure(world, (int)Setting.ForceLimit, forceLimit));
            Check(Native.sb_configure(world, (int)Setting.Rise, rise));
            Check(Native.sb_configure(world, (int)Setting.Vibration, vibration ? 1.0 : 0.0));
            Check(Native.sb_choose(world, block.Length == 0 ? 0 : Find(block)));
            running = true;
            servo = new Thread(Loop);
            servo.IsBackground = true;
            servo.Priority = System.Threading.ThreadPriority.Highest;
            servo.Start();
        }

        /// <summary>Take another block from the next tick on.</summary>
        public void Choose(string name)
        {
            Interlocked.Exchange(ref wanted, Find(name));
        }

        // Whatever ends the loop, an exception of ReadHand included, takes the force off the hand
        void Loop()
        {
            try
            {
                Serve();
            }
            catch (Exception problem)
            {
                UnityEngine.Debug.LogException(problem);
            }
            finally
            {
                if (WriteForce != null) WriteForce(0.0, 0.0, 0.0);
            }
        }

        void Serve()
        {
            double[] hand = { 0.0, 0.0, 1.0 };
            double[] velocity = new double[3];
            Stopwatch watch = Stopwatch.StartNew();
            Func<double> seconds = Seconds ?? (() => watch.Elapsed.TotalSeconds);
            double before = 0.0, due = 0.0;
            Output output;
            while (running)
            {
                due += 1.0 / rate;
                while (running && seconds() < due) Thread.SpinWait(50);
                double now = seconds();
                if (now - due > 0.1) due = now;
                int next = Interlocked.Exchange(ref wanted, -1);
                if (next >= 0) Native.sb_choose(world, next);
                if (ReadHand != null) ReadHand(hand, velocity);
                if (tooth) Native.sb_tick_tooth(world, hand, velocity, now - before, out output);
                else Native.sb_tick(world, hand, velocity, now - before, out output);
                before = now;
                if (WriteForce != null) WriteForce(output.forceX, output.forceY, output.forceZ);
                lock (gate) shown = output;
            }
        }

        void OnDestroy()
        {
            running = false;
            if (servo != null) servo.Join();
            if (world != IntPtr.Zero) Native.sb_destroy(world);
            world = IntPtr.Zero;
        }

        int Find(string name)
        {
            int found = Native.sb_find(world, Native.Text(name));
            if (found < 0)
                throw new ArgumentException("there is no block " + name + " in " + blocks);
            return found;
        }

        int Check(int result)
        {
            if (result < 0)
            {
                throw new InvalidOperationException(Native.Read(Native.sb_message(world)));
            }
            return result;
        }
    }
}
