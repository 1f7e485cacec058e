!> The laws of a model in the frequency domain: from coefficients of the motion to coefficients of the forces, by sampling on the
!> torus and projection back (alternating frequency/time).
!>
!> Source: docs/why/theory.md, sections 5.3 to 5.5.
module hb_projected_laws
   use hb_error, only: error_t
   use hb_harmonics, only: harmonics_t
   use hb_kinds, only: two_pi, wp
   use hb_law, only: law_box_t
   use hb_law_samples, only: law_samples_t
   use hb_sampled_laws, only: new_sampled_laws, sampled_laws_t
   use hb_threads, only: n_threads
   use hb_torus, only: torus_t
   use hb_transform, only: new_transform, product_table_t, transform_t
   implicit none
   private
   public :: new_projected_laws, part_of, projected_laws_t, slope

   !> Parts of the table of products: the factors of the slopes.
   type :: slope_t
      integer :: by_motion = 1
      integer :: by_rate = 2
      integer :: by_reaction = 3
   end type slope_t
   type(slope_t), parameter :: slope = slope_t()
   integer, parameter :: n_slopes = 3

   !> Owner of external resources: call `destroy`.
   type, extends(sampled_laws_t) :: projected_laws_t
      type(transform_t) :: transform
      real(wp) :: factor = 1.0_wp                                     !! of the forces in the balance, 0 to 1 along a homotopy
      type(product_table_t) :: table                                  !! of products with slopes, after `prepare_products`
      integer :: n_lanes = 1                                          !! threads that tabulate at the same time, each in own parts
      real(wp), allocatable, private :: u_before(:, :)                ! (n_coefficients, n_dofs) motion a step of time earlier
   contains
      procedure :: bring_to => projected_laws_bring_to
      procedure :: bring_step_slopes => projected_laws_bring_step_slopes
      procedure :: prepare_products => projected_laws_prepare_products
      procedure :: tabulate => projected_laws_tabulate
      procedure :: tabulate_kinks => projected_laws_tabulate_kinks
      procedure :: destroy => projected_laws_destroy
   end type projected_laws_t

contains

   !> Prepares laws on coordinates and the transforms between their coefficients and samples. Transforms that are planned already
   !> remain.
   subroutine new_projected_laws(self, laws, n_coordinates, harmonics, torus, omega, error)
      type(projected_laws_t), intent(inout) :: self
      type(law_box_t), intent(in) :: laws(:)                          !! on coordinates; no two multipliers on one
      integer, intent(in) :: n_coordinates
      type(harmonics_t), intent(in) :: harmonics
      type(torus_t), intent(in) :: torus
      real(wp), intent(in) :: omega(:)                                !! base frequencies [rad/s], (n_tones)
      type(error_t), allocatable, intent(out) :: error
      logical :: is_new

      self%factor = 1.0_wp
      call new_transform(self%transform, harmonics, torus, n_coordinates, error, is_new=is_new)
      if (allocated(error)) return
      if (is_new .or. self%n_lanes > 1) self%table = product_table_t()
      self%n_lanes = 1
      call new_sampled_laws(self%sampled_laws_t, laws, n_coordinates, torus, omega, error)
      if (allocated(self%u_before)) deallocate (self%u_before)
      if (self%has_memory) allocate (self%u_before(harmonics%n_coefficients, n_coordinates))
   end subroutine new_projected_laws

   !> Transforms a motion, or a direction of it, to the torus: q, and the other arguments of the laws. Laws with
   !> memory need the steps of time that end at the samples: motion at their start, rates at both ends.
   subroutine projected_laws_bring_to(self, samples, u, reaction, frequencies)
      class(projected_laws_t), intent(inout) :: self
      type(law_samples_t), intent(inout) :: samples                   !! all but forces
      real(wp), intent(in), contiguous :: u(:, :)                     !! [m], (n_coefficients, n_dofs)
      real(wp), intent(in), contiguous :: reaction(:, :)              !! [N], as u
      real(wp), intent(in), contiguous :: frequencies(:)              !! j.omega [rad/s], (n_harmonics)
      real(wp) :: angle(size(frequencies))

      samples%n_motions = samples%n_motions + 1
      call self%transform%to_samples(u, samples%q%values)
      if (self%needs_velocity) call self%transform%to_rate_samples(u, frequencies, samples%v%values)
      if (self%needs_reaction) call self%transform%to_samples(reaction, samples%s%values)
      if (.not. self%has_memory) return
      angle = frequencies*self%characteristic%step
      self%u_before = self%transform%harmonics%times(cmplx(cos(angle), -sin(angle), wp), u)
      call self%transform%to_samples(self%u_before, samples%q_before%values)
      call self%transform%to_rate_samples(u, angle, samples%step_rate%values)
      call self%transform%to_rate_samples(self%u_before, angle, samples%step_rate_before%values)
   end subroutine projected_laws_bring_to

   !> Computes in `along` the derivative of the steps of time with respect to base frequency m, after `bring_to` of
   !> the motion: motion at their start, rates at both ends, and that of the weights of the neighbours there. With the
   !> angle phi = j.omega step and c the amplitude at the end of a step, d(c exp(-i phi)) = -i c exp(-i phi) dphi, and
   !> d(i phi c exp(-i phi)) = (i + phi) c exp(-i phi) dphi.
   subroutine projected_laws_bring_step_slopes(self, u, omega, m, weight_slope)
      class(projected_laws_t), intent(inout) :: self
      real(wp), intent(in) :: u(:, :)                                 !! [m], (n_coefficients, n_dofs)
      real(wp), intent(in) :: omega(:)                                !! base frequencies [rad/s], (n_tones)
      integer, intent(in) :: m                                        !! tone
      real(wp), allocatable, intent(inout) :: weight_slope(:)         !! of `characteristic`
      real(wp), dimension(self%transform%harmonics%n_harmonics) :: angle, angle_slope, frequencies, turns
      real(wp) :: rate_slope(size(u, 1), size(u, 2)), step_slope

      associate (set => self%transform%harmonics)
         frequencies = set%frequencies(omega)
         turns = real(set%tuples(m, :), wp)
         weight_slope = 0.0_wp*self%characteristic%weight
         call self%characteristic%frequency_slopes(m, step_slope, weight_slope)
         angle = frequencies*self%characteristic%step
         angle_slope = turns*self%characteristic%step
         if (m == self%characteristic%tone) angle_slope = (frequencies - turns*omega(m))*step_slope   ! this tone cancels
         rate_slope = set%times(cmplx(angle, 1.0_wp, wp)*angle_slope, self%u_before)
      end associate
      call self%transform%to_rate_samples(self%u_before, -angle_slope, self%along%q_before%values)
      call self%transform%to_rate_samples(u, angle_slope, self%along%step_rate%values)
      call self%transform%to_samples(rate_slope, self%along%step_rate_before%values)
   end subroutine projected_laws_bring_step_slopes

   !> Prepares products with slopes at their first use.
   subroutine projected_laws_prepare_products(self, error)
      class(projected_laws_t), intent(inout) :: self
      type(error_t), allocatable, intent(out) :: error

      if (allocated(self%table%mean)) return
      self%n_lanes = n_threads(self%jacobian%n_pairs*self%transform%torus%n_total)
      call self%transform%prepare_products(self%table, n_slopes*self%n_lanes, error, self%n_lanes)
   end subroutine projected_laws_prepare_products

   !> Fills the parts of a lane with the slopes of pair i, times `factor`.
   subroutine projected_laws_tabulate(self, i, lane)
      class(projected_laws_t), intent(inout) :: self
      integer, intent(in) :: i
      integer, intent(in) :: lane                                     !! 1 to n_lanes

      associate (jacobian => self%jacobian)
         call self%transform%tabulate_product(jacobian%df_dq%values, i, self%table, part_of(slope%by_motion, lane), self%factor, &
                                              lane)
         if (self%needs_velocity) &
            call self%transform%tabulate_product(jacobian%df_dv%values, i, self%table, part_of(slope%by_rate, lane), self%factor, &
                                                 lane)
         if (self%needs_reaction) &
            call self%transform%tabulate_product(jacobian%df_ds%values, i, self%table, part_of(slope%by_reaction, lane), &
                                                 self%factor, lane)
      end associate
   end subroutine projected_laws_tabulate

   !> The part of the table with a slope in a lane.
   pure integer function part_of(of, lane)
      integer, intent(in) :: of                                       !! one of `slope`
      integer, intent(in) :: lane

      part_of = of + (lane - 1)*n_slopes
   end function part_of

   !> Stores the response of the force of a line of the laws' kinks to its coordinate at a neighbour of each sample in
   !> the table, times `factor`, like slopes of the motion, and returns the angle by which the wave exp(i j.tau) is
   !> advanced there.
   subroutine projected_laws_tabulate_kinks(self, line, part, angle, is_any)
      class(projected_laws_t), intent(inout) :: self
      integer, intent(in) :: line
      integer, intent(in) :: part                                     !! number of the neighbour, 1 to kinks%grid%n_parts
      real(wp), intent(out) :: angle(:)                               !! [rad], (n_harmonics)
      logical, intent(out) :: is_any                                  !! false: no response, the table is unchanged
      real(wp), allocatable :: response(:, :)

      associate (torus => self%transform%torus)
         allocate (response(torus%n_total, 1))
         call self%kinks%fill_part(line, part, response(:, 1), is_any)
         if (.not. is_any) return
         call self%transform%tabulate_product(response, 1, self%table, slope%by_motion, self%factor)
         angle = matmul(two_pi*self%kinks%grid%shift(part)/torus%n_samples, real(self%transform%harmonics%tuples, wp))
      end associate
   end subroutine projected_laws_tabulate_kinks

   !> Frees transforms and samples; safe to call twice.
   subroutine projected_laws_destroy(self)
      class(projected_laws_t), intent(inout) :: self

      call self%sampled_laws_t%destroy()
      call self%transform%destroy()
   end subroutine projected_laws_destroy
end module hb_projected_laws
