// As much of Unity as StepBlocks.cs names, so that a compiler can read it without Unity.
using System;

namespace UnityEngine
{
    public class MonoBehaviour { }

    public static class Debug
    {
        public static void LogException(Exception problem)
        {
            Console.Error.WriteLine(problem.Message);
        }
    }

    public struct Vector3
    {
        public float x, y, z;
        public Vector3(float x, float y, float z) { this.x = x; this.y = y; this.z = z; }
    }

    [AttributeUsage(AttributeTargets.Field)]
    public sealed class TooltipAttribute : Attribute { public TooltipAttribute(string text) { } }

    public static class Application { public static string streamingAssetsPath = "."; }
}
