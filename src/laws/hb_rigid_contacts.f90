!> Several rigid contacts at once, gaps g_i + a_i.z >= 0, by the reaction that equilibrium requires.
!>
!> Any number of contacts may touch: if their shapes a_i span a plane, the admissible set there is a convex polygon.
!> With an orthonormal basis E of the plane, w = E z and the reaction p, the loads l_i map w + E p/eps onto the
!> polygon along E c_i, where c_i = -(a_i + mu_i b_i) is the action of contact i on the structure. At a solution p =
!> sum of l_i c_i, so that w is mapped to itself: no gap is negative, and only closed gaps carry load, for any eps >
!> 0. Source: docs/why/theory.md, section 5.3. Sign: f stands beside K q on the left-hand side.
module hb_rigid_contacts
   use hb_contact_polygon, only: contact_polygon_t, landing_t, new_contact_polygon
   use hb_kinds, only: wp
   use hb_law, only: defects_t
   implicit none
   private
   public :: new_rigid_contacts, rigid_contacts_t

   real(wp), parameter :: min_outside = 1.0e-10_wp                     ! part of a shape outside the plane that is neglected

   type :: rigid_contacts_t
      type(contact_polygon_t) :: polygon
      real(wp) :: augmentation = 1.0_wp                               !! eps [N/m]
      logical, private :: is_given = .false.                          ! eps is given by the user
      real(wp), allocatable, private :: plane(:, :)                   ! E, (2, n_coordinates)
      real(wp), allocatable, private :: force(:, :)                   ! c_i of the edges, (n_edges, n_coordinates)
   contains
      procedure :: propose => rigid_contacts_propose
      procedure :: evaluate => rigid_contacts_evaluate
      procedure :: correct => rigid_contacts_correct
      procedure :: defects => rigid_contacts_defects
   end type rigid_contacts_t

contains

   !> Creates rigid contacts; `failure` states why these cannot be rigid.
   pure subroutine new_rigid_contacts(self, shapes, pushes, gaps, augmentation, failure)
      type(rigid_contacts_t), intent(out) :: self
      real(wp), intent(in) :: shapes(:, :)                            !! a_i, no row zero, (n_contacts, n_coordinates)
      real(wp), intent(in) :: pushes(:, :)                            !! a_i + mu_i b_i, as shapes
      real(wp), intent(in) :: gaps(:)                                 !! [m], (n_contacts)
      real(wp), intent(in) :: augmentation                            !! eps [N/m], 0: as proposed
      character(:), allocatable, intent(out) :: failure               !! empty on success

      self%is_given = augmentation > 0.0_wp
      if (self%is_given) self%augmentation = augmentation
      call find_plane(self, shapes, failure)
      if (len(failure) > 0) return
      call new_contact_polygon(self%polygon, -matmul(shapes, transpose(self%plane)), gaps, &
                               -matmul(pushes, transpose(self%plane)), failure)
      if (len(failure) == 0) self%force = -pushes(self%polygon%contact, :)
   end subroutine new_rigid_contacts

   !> Orthonormal basis of the shapes: the longest, then the remainder of the one farthest from it, both rotated so
   !> that the first one is along a coordinate as far as possible. Coordinates that are not coupled then remain so
   !> even in rounding.
   pure subroutine find_plane(self, shapes, failure)
      type(rigid_contacts_t), intent(inout) :: self
      real(wp), intent(in) :: shapes(:, :)
      character(:), allocatable, intent(out) :: failure
      real(wp) :: left(size(shapes, 1), size(shapes, 2)), largest, lengths(size(shapes, 2)), turn(2)
      integer :: i, k, pass

      failure = ""
      allocate (self%plane(2, size(shapes, 2)), source=0.0_wp)
      left = shapes
      largest = sqrt(maxval(sum(left**2, dim=2)))
      do i = 1, 2
         k = maxloc(sum(left**2, dim=2), dim=1)
         if (norm2(left(k, :)) <= min_outside*largest) exit
         self%plane(i, :) = left(k, :)/norm2(left(k, :))
         do pass = 1, 2
            left = left - matmul(matmul(left, transpose(self%plane(:i, :))), self%plane(:i, :))
         end do
      end do
      lengths = norm2(self%plane, dim=1)
      k = findloc(lengths >= maxval(lengths) - min_outside, .true., dim=1)
      turn = self%plane(:, k)/lengths(k)
      self%plane = matmul(reshape([turn(1), -turn(2), turn(2), turn(1)], [2, 2]), self%plane)
      if (sqrt(maxval(sum(left**2, dim=2))) > min_outside*largest) failure = "rigid contacts may depend on two independent "// &
         "combinations of 'dofs', and these depend on more (blades with different 'shares' do)"
   end subroutine find_plane

   !> Sets eps unless given by the user.
   pure subroutine rigid_contacts_propose(self, augmentation)
      class(rigid_contacts_t), intent(inout) :: self
      real(wp), intent(in) :: augmentation                            !! [N/m], > 0

      if (.not. self%is_given) self%augmentation = augmentation
   end subroutine rigid_contacts_propose

   !> Forces of all samples, and their derivatives when these are present.
   subroutine rigid_contacts_evaluate(self, z, p, f, df_dz, df_dp)
      class(rigid_contacts_t), intent(in) :: self
      real(wp), intent(in) :: z(:, :), p(:, :)                        !! [m], [N], (n_samples, n_coordinates)
      real(wp), intent(out) :: f(:, :)                                !! [N], as z
      real(wp), intent(out), optional :: df_dz(:, :, :), df_dp(:, :, :)
      type(landing_t) :: landing
      real(wp) :: slope(2, size(z, 2))
      integer :: b, i, k

      f = 0.0_wp
      if (present(df_dz)) df_dz = 0.0_wp
      if (present(df_dp)) df_dp = 0.0_wp
      do i = 1, size(z, 1)
         landing = self%polygon%land(matmul(self%plane, z(i, :) + p(i, :)/self%augmentation))
         if (landing%n_active == 0) cycle
         slope = matmul(landing%slope, self%plane)
         do k = 1, landing%n_active
            associate (c => self%force(landing%edge(k), :))
               f(i, :) = f(i, :) + self%augmentation*landing%load(k)*c
               if (.not. (present(df_dz) .and. present(df_dp))) cycle
               do b = 1, size(z, 2)
                  df_dp(i, :, b) = df_dp(i, :, b) + slope(k, b)*c
               end do
            end associate
         end do
         if (present(df_dz) .and. present(df_dp)) df_dz(i, :, :) = self%augmentation*df_dp(i, :, :)
      end do
   end subroutine rigid_contacts_evaluate

   !> Moves coordinates onto the polygon, along the directions of the contacts.
   pure subroutine rigid_contacts_correct(self, z, corrected)
      class(rigid_contacts_t), intent(in) :: self
      real(wp), intent(in) :: z(:, :)
      real(wp), intent(out) :: corrected(:, :)                        !! as z
      type(landing_t) :: landing
      integer :: i, k

      corrected = z
      do i = 1, size(z, 1)
         landing = self%polygon%land(matmul(self%plane, z(i, :)))
         do k = 1, landing%n_active
            corrected(i, :) = corrected(i, :) - landing%load(k)*matmul(self%polygon%direction(landing%edge(k), :), self%plane)
         end do
      end do
   end subroutine rigid_contacts_correct

   !> Largest penetration, largest product of a contact's share in the reaction and its distance, and the largest part
   !> of the reaction that no contact can exert.
   pure function rigid_contacts_defects(self, z, p) result(defects)
      class(rigid_contacts_t), intent(in) :: self
      real(wp), intent(in) :: z(:, :), p(:, :)                        !! [m], [N], (n_samples, n_coordinates)
      type(defects_t) :: defects
      type(landing_t) :: landing
      real(wp) :: gap(self%polygon%n_edges), pull
      integer :: i, k

      do i = 1, size(z, 1)
         gap = self%polygon%distance - matmul(self%polygon%normal, matmul(self%plane, z(i, :)))
         defects%penetration = max(defects%penetration, -minval(gap))
         call self%polygon%resolve(matmul(self%plane, p(i, :)), landing, pull)
         defects%tension = max(defects%tension, pull)
         do k = 1, landing%n_active
            defects%complementarity = max(defects%complementarity, landing%load(k)*abs(gap(landing%edge(k))))
         end do
      end do
   end function rigid_contacts_defects
end module hb_rigid_contacts
