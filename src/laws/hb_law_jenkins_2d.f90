!> Elastic Coulomb friction in a plane: f = k (z - w), |f| <= mu N, with two tangential coordinates.
!>
!> States: the place w of the slider. It is dragged like a dog on a leash of length mu N/k: taut, it moves towards the end
!> z of the spring, so that friction opposes sliding. Along the straight line between two samples its way (a tractrix) is
!> known in closed form: with theta the angle of the leash to the line, tan(theta/2) falls as exp(-way k/(mu N)).
!> Source: docs/why/theory.md, section 5.5. Sign: f stands beside K q on the left-hand side.
module hb_law_jenkins_2d
   use hb_hysteretic_law, only: hysteretic_law_t, path_part
   use hb_kinds, only: wp
   use hb_law, only: place_coordinate, read_place
   use hb_properties, only: properties_t
   use hb_structure, only: structure_t
   use hb_text, only: string_t
   implicit none
   private
   public :: jenkins_2d_t

   type, extends(hysteretic_law_t) :: jenkins_2d_t
      real(wp) :: stiffness = 0.0_wp                                  !! k [N/m], the same in all directions
      real(wp) :: limit = 0.0_wp                                      !! mu N [N]
   contains
      procedure :: read => jenkins_2d_read
      procedure :: advance => jenkins_2d_advance
      procedure :: force => jenkins_2d_force
   end type jenkins_2d_t

contains

   !> Reads a `&law type = 'jenkins_2d'` group.
   subroutine jenkins_2d_read(self, group, structure)
      class(jenkins_2d_t), intent(inout) :: self
      type(properties_t), intent(inout) :: group
      type(structure_t), intent(in) :: structure
      type(string_t), allocatable :: names(:)
      real(wp), allocatable :: weights(:)

      call group%get("stiffness", self%stiffness)
      call group%get("limit", self%limit)
      self%n_states = 2
      self%is_odd = .true.
      if (self%stiffness > 0.0_wp) self%length_scale = self%limit/self%stiffness    ! not so after a problem
      call read_place(self, group, structure)
      call group%get("second_dofs", names)
      if (.not. allocated(names)) return
      call group%get("second_weights", weights, n=size(names))
      call place_coordinate(self, group, structure, "second_dofs", names, weights)
   end subroutine jenkins_2d_read

   subroutine jenkins_2d_advance(self, s_old, path, s_new, ds_ds_old, ds_dpath)
      class(jenkins_2d_t), intent(in) :: self
      real(wp), intent(in), contiguous :: s_old(:, :), path(:, :, :)
      real(wp), intent(out), contiguous :: s_new(:, :)
      real(wp), intent(out), contiguous, optional :: ds_ds_old(:, :, :), ds_dpath(:, :, :, :)
      real(wp) :: elongation(2), by_elongation(2, 2), by_displacement(2, 2), displacement(2)
      integer :: c, i

      if (present(ds_dpath)) ds_dpath = 0.0_wp
      do i = 1, size(s_old, 1)
         elongation = path(i, :, path_part%at_start) - s_old(i, :)
         displacement = path(i, :, path_part%at_end) - path(i, :, path_part%at_start)
         call drag(self%limit/self%stiffness, displacement, elongation, by_elongation, by_displacement)
         s_new(i, :) = path(i, :, path_part%at_end) - elongation
         if (.not. (present(ds_ds_old) .and. present(ds_dpath))) cycle
         ds_ds_old(i, :, :) = by_elongation
         ds_dpath(i, :, :, path_part%at_start) = by_displacement - by_elongation
         ds_dpath(i, :, :, path_part%at_end) = -by_displacement
         do c = 1, 2
            ds_dpath(i, c, c, path_part%at_end) = ds_dpath(i, c, c, path_part%at_end) + 1.0_wp
         end do
      end do
   end subroutine jenkins_2d_advance

   !> Leash after a straight displacement of its end, and its derivatives by the leash before and by the displacement.
   !>
   !> A leash longer than it may be, as interpolation may give it, is cut first. Until it is taut the slider stays.
   pure subroutine drag(longest, displacement, elongation, by_elongation, by_displacement)
      real(wp), intent(in) :: longest                                 !! [m], > 0
      real(wp), intent(in) :: displacement(2)                         !! [m]
      real(wp), intent(inout) :: elongation(2)                        !! [m]
      real(wp), intent(out) :: by_elongation(2, 2), by_displacement(2, 2) !! last axis: the component differentiated by
      real(wp) :: cut(2, 2), length
      integer :: c

      cut = reshape([1.0_wp, 0.0_wp, 0.0_wp, 1.0_wp], [2, 2])
      length = norm2(elongation)
      if (length > longest) then
         do c = 1, 2
            cut(:, c) = longest/length*(cut(:, c) - elongation*elongation(c)/length**2)
         end do
         elongation = longest/length*elongation
      end if
      if (norm2(elongation + displacement) <= longest .or. .not. any(abs(displacement) > 0.0_wp)) then
         elongation = elongation + displacement
         by_elongation = cut
         by_displacement = reshape([1.0_wp, 0.0_wp, 0.0_wp, 1.0_wp], [2, 2])
      else
         call drag_taut(longest, displacement, elongation, by_elongation, by_displacement)
         by_elongation = matmul(by_elongation, cut)
      end if
   end subroutine drag

   !> Drags the slider by a leash that becomes taut on the way, and is not too long before; with its derivatives as `drag`.
   pure subroutine drag_taut(longest, displacement, elongation, by_elongation, by_displacement)
      real(wp), intent(in) :: longest, displacement(2)
      real(wp), intent(inout) :: elongation(2)
      real(wp), intent(out) :: by_elongation(2, 2), by_displacement(2, 2)
      ! Derivatives by leash(1:2) and displacement(1:2) are carried along: d_x(4) or d_x(2, 4) for each x.
      real(wp) :: d_elongation(2, 4), d_displacement(2, 4), a, b, c, root, share, d_share(4), length, d_length(4), e(2), d_e(2, 4)
      real(wp) :: taut(2), d_taut(2, 4), cosine, sine, d_cosine(4), d_sine(4), t, d_t(4), slid, d_slid(4)
      integer :: k

      d_elongation = 0.0_wp
      d_displacement = 0.0_wp
      do k = 1, 2
         d_elongation(k, k) = 1.0_wp
         d_displacement(k, k + 2) = 1.0_wp
      end do
      length = norm2(displacement)
      e = displacement/length
      d_length = matmul(e, d_displacement)
      do k = 1, 4
         d_e(:, k) = (d_displacement(:, k) - e*d_length(k))/length
      end do

      ! |leash + share way| = longest: a share**2 + 2 b share + c = 0
      a = length**2
      b = dot_product(elongation, displacement)
      c = min(dot_product(elongation, elongation) - longest**2, 0.0_wp)
      root = sqrt(b**2 - a*c)
      if (b > 0.0_wp) then
         share = -c/(b + root)
      else
         share = (root - b)/a
      end if
      share = min(max(share, 0.0_wp), 1.0_wp)
      taut = elongation + share*displacement
      d_share = 0.0_wp
      if (root > epsilon(1.0_wp)*length*longest) d_share = -matmul(taut, d_elongation + share*d_displacement)/root
      do k = 1, 4
         d_taut(:, k) = d_elongation(:, k) + share*d_displacement(:, k) + displacement*d_share(k)
      end do

      ! The tractrix: angle of the leash to the displacement, from where it is taut
      cosine = max(dot_product(taut, e)/longest, 0.0_wp)
      sine = (e(1)*taut(2) - e(2)*taut(1))/longest
      d_cosine = (matmul(taut, d_e) + matmul(e, d_taut))/longest
      d_sine = (e(1)*d_taut(2, :) + d_e(1, :)*taut(2) - e(2)*d_taut(1, :) - d_e(2, :)*taut(1))/longest
      slid = (1.0_wp - share)*length/longest
      d_slid = ((1.0_wp - share)*d_length - length*d_share)/longest
      t = exp(-slid)*sine/(1.0_wp + cosine)                           ! tan(angle/2) at the end
      d_t = exp(-slid)*(d_sine - sine*d_cosine/(1.0_wp + cosine))/(1.0_wp + cosine) - t*d_slid
      cosine = (1.0_wp - t**2)/(1.0_wp + t**2)
      sine = 2.0_wp*t/(1.0_wp + t**2)
      d_cosine = -2.0_wp*sine/(1.0_wp + t**2)*d_t
      d_sine = 2.0_wp*cosine/(1.0_wp + t**2)*d_t
      elongation = longest*[cosine*e(1) - sine*e(2), cosine*e(2) + sine*e(1)]
      by_elongation(1, :) = longest*(d_cosine(:2)*e(1) + cosine*d_e(1, :2) - d_sine(:2)*e(2) - sine*d_e(2, :2))
      by_elongation(2, :) = longest*(d_cosine(:2)*e(2) + cosine*d_e(2, :2) + d_sine(:2)*e(1) + sine*d_e(1, :2))
      by_displacement(1, :) = longest*(d_cosine(3:)*e(1) + cosine*d_e(1, 3:) - d_sine(3:)*e(2) - sine*d_e(2, 3:))
      by_displacement(2, :) = longest*(d_cosine(3:)*e(2) + cosine*d_e(2, 3:) + d_sine(3:)*e(1) + sine*d_e(1, 3:))
   end subroutine drag_taut

   subroutine jenkins_2d_force(self, z, s, f, df_dz, df_ds)
      class(jenkins_2d_t), intent(in) :: self
      real(wp), intent(in), contiguous :: z(:, :), s(:, :)
      real(wp), intent(out), contiguous :: f(:, :)
      real(wp), intent(out), contiguous, optional :: df_dz(:, :, :), df_ds(:, :, :)
      integer :: c

      f = self%stiffness*(z - s)
      if (.not. (present(df_dz) .and. present(df_ds))) return
      df_dz = 0.0_wp
      df_ds = 0.0_wp
      do c = 1, 2
         df_dz(:, c, c) = self%stiffness
         df_ds(:, c, c) = -self%stiffness
      end do
   end subroutine jenkins_2d_force
end module hb_law_jenkins_2d
